// SPDX-License-Identifier: Apache-2.0
// A learner of another make (tests/foreign/README.md) in the place of policy_service.
#include <gtest/gtest.h>

#include <cstdio>
#include <map>
#include <nlohmann/json.hpp>

#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

struct Result {
  double completed = -1, spl = -1;
};

/// Returns what the learner printed, by "traversal" or "traversal, shuffled".
std::map<std::string, Result> results(const std::string& output) {
  std::map<std::string, Result> found;
  for (const std::string& line : lines_of(output)) {
    const std::size_t colon = line.find(": ");
    int tasks;
    Result result;
    if (colon != std::string::npos && std::sscanf(line.c_str() + colon, ": %d tasks, completed %lf, SPL %lf", &tasks,
                                                  &result.completed, &result.spl) == 3)
      found[line.substr(0, colon)] = result;
  }
  return found;
}

class Foreign : public VendorTest {
 protected:
  static std::unique_ptr<Service> learner(const Trial& run, Arguments more) {
    more.insert(more.begin(), {FOREIGN_LEARNER, "--domain", std::to_string(run.domain()), "--max-steps", "96",
                               "--tasks", "300", "--evaluate", "fall"});
    return std::make_unique<Service>(more, run.folder() / "foreign.log");
  }
};
CITYLEARN_EACH_VENDOR(Foreign);

/// With 96 steps for 128 frames a blind sweep does not get everywhere.
TEST_P(Foreign, LearnsFromOurEnvServicesAndLeavesTheBlindControlBehind) {
  Trial run(GetParam());
  const auto summer = run.env("summer"), fall = run.env("fall");
  const auto foreign = learner(run, {"--evaluate", "summer"});
  ASSERT_EQ(foreign->wait(kLongWait), 0) << foreign->output() << fall->output();
  const std::map<std::string, Result> found = results(foreign->output());
  ASSERT_EQ(found.size(), 4u) << foreign->output();
  // The env_services are free for the next one.
  const auto blind = run.policy({"--mode", "evaluate", "--agent", "blind", "--max-steps", "96", "--tasks", "300",
                                 "--evaluate", "summer,fall", "--output", run.folder() / "blind"});
  ASSERT_EQ(blind->wait(kLongWait), 0) << blind->output();
  const Json controls = Json::parse(contents(run.folder() / "blind/summary.json"))["evaluate"];
  for (const std::string traversal : {"summer", "fall"}) {
    const Result& result = found.at(traversal);
    EXPECT_GT(result.completed, controls[traversal]["completed"].get<double>()) << foreign->output();
    EXPECT_GT(result.spl, controls[traversal]["spl"].get<double>() + 0.05) << foreign->output();
    EXPECT_LT(found.at(traversal + ", shuffled").spl, result.spl - 0.3) << "it navigates by what it sees";
  }
}

/// Each observation is answered and learned from exactly once, so what the wire does changes nothing.
TEST_P(Foreign, LearnsTheSameOverAWireThatLosesRepeatsAndReorders) {
  std::map<std::string, std::string> said;
  const std::string lossy = "lossy,drop=0.05,repeat=0.05,reorder=0.05,seed=3:";
  for (const std::string& middleware : {std::string(GetParam()), lossy + GetParam()}) {
    Trial run(middleware);
    const auto summer = run.env("summer"), fall = run.env("fall");
    const auto foreign = learner(run, {"--tasks", "50", "--ticks", "400", "--frames", "64"});
    ASSERT_EQ(foreign->wait(kLongWait), 0) << foreign->output();
    for (const std::string& line : lines_of(foreign->output()))  // but for how it waited, as on a busy machine
      if (!line.starts_with("foreign_learner: ")) said[middleware] += line + "\n";
    const std::map<std::string, Result> found = results(foreign->output());
    ASSERT_TRUE(found.contains("fall")) << foreign->output();
    EXPECT_GT(found.at("fall").completed, 0.95) << foreign->output();
    EXPECT_GT(found.at("fall").spl, 0.9) << foreign->output();
  }
  EXPECT_EQ(said.begin()->second, said.rbegin()->second);
}

TEST_P(Foreign, WelcomesAnEnvServiceBackAndAcknowledgesEveryEpisode) {
  Trial run(GetParam());
  auto summer = run.env("summer");
  const auto fall = run.env("fall");
  const auto foreign = learner(run, {"--ticks", "10000"});
  ASSERT_TRUE(summer->says("training", kLongWait)) << summer->output();
  summer->send(SIGKILL);
  summer->wait(seconds(5));
  ASSERT_EQ(results(foreign->output()).size(), 0u) << "it had finished before";
  summer = run.env("summer");
  ASSERT_EQ(foreign->wait(kLongWait), 0) << foreign->output();
  EXPECT_EQ(results(foreign->output()).size(), 2u) << foreign->output();
  for (Service* env : {summer.get(), fall.get()}) {
    ASSERT_EQ(env->end(SIGTERM, seconds(5)), 0);
    EXPECT_TRUE(contains(env->output(), "all acknowledged"));
  }
}

TEST(ForeignAlone, WrongInputIsOneClearLine) {
  Folder folder;
  const std::vector<std::pair<Arguments, std::string>> cases = {
      {{"--speed", "9"}, "--speed"},
      {{"--domain", "300"}, "0..232"},
      {{"--tasks"}, "--tasks needs"},
      {{"--domain", "199", "--session", "nobody", "--wait", "1"}, "no env_service"}};
  for (const auto& [arguments, wanted] : cases) {
    Service learner(Arguments{FOREIGN_LEARNER} + arguments, folder / "log");
    EXPECT_EQ(learner.wait(seconds(20)), 1) << wanted;
    EXPECT_TRUE(contains(learner.output(), wanted));
  }
}

}  // namespace
}  // namespace citylearn::testing
