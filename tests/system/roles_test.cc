// SPDX-License-Identifier: Apache-2.0
// A learner and its actors: real processes over loopback DDS.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/processes/learning.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

class Pairings : public ::testing::TestWithParam<std::pair<const char*, const char*>> {
 protected:
  /// Return the vendor of the learner and that of the actors; env_services use both.
  std::string here() const { return GetParam().first; }
  std::string there() const { return GetParam().second; }
};
INSTANTIATE_TEST_SUITE_P(, Pairings,
                         ::testing::Values(std::pair{"fastdds", "fastdds"}, std::pair{"cyclonedds", "cyclonedds"},
                                           std::pair{"fastdds", "cyclonedds"}),
                         [](const auto& pair) { return std::string(pair.param.first) + "_" + pair.param.second; });

TEST_P(Pairings, TwoActorsTrainAndTheLearnerEvaluates) {
  Learning run(here()), other(there(), run);
  const auto one = run.trial.env("summer", {"--id", "one"}), two = other.trial.env("summer", {"--id", "two"});
  const auto a = other.actor("a"), b = other.actor("b");
  const auto learner = run.learner(300, {"--environments", "2"});
  ASSERT_EQ(learner->wait(kWholeRun), 0) << learner->output() << a->output();
  for (const auto* actor : {a.get(), b.get()})
    EXPECT_TRUE(contains(actor->output(), "serving env_service")) << a->output() << b->output();
  EXPECT_EQ(a->wait(seconds(10)), 0) << a->output();
  EXPECT_EQ(b->wait(seconds(10)), 0) << b->output();
  const Json summary = Json::parse(contents(run.trial.folder() / "out/summary.json"));
  EXPECT_EQ(summary["train"]["steps"], 300 * 512);
  EXPECT_GE(summary["train"]["policy_lag"].get<double>(), 0);
  EXPECT_GT(summary["train"]["episodes"].get<int>(), 100);
  EXPECT_GE(summary["evaluate"]["summer"]["spl"].get<double>(), 0.95) << summary.dump(1);
  run.expect_whole_records();
}

TEST(CommandLine, WrongRolesAreOneClearLine) {
  Learning run("cyclonedds");
  const auto summer = run.trial.env("summer");
  const WrongInputs cases = {
      {"unknown role", {{"--role", "critic"}, "--role"}},
      {"a learner in lockstep", {{"--role", "learner", "--lockstep"}, "--lockstep"}},
      {"an actor that evaluates", {{"--role", "actor", "--mode", "evaluate"}, "--mode evaluate"}},
      {"sequences too long",
       {{"--role", "learner", "--trainer-segment", "8192", "--trainer-sequence", "8192"}, "--trainer-sequence"}},
  };
  expect_one_clear_line(run.trial, cases, seconds(20));
}

}  // namespace
}  // namespace citylearn::testing
