// SPDX-License-Identifier: Apache-2.0
// What a training keeps, says and does when its SPL is high, and when it collapses: in one process, and as a learner
// with two actors.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <map>
#include <nlohmann/json.hpp>

#include "core/wire/node.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "tests/support/processes/learning.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

/// A training in either role, whose checkpoints are every ten updates.
class BestCheckpointRun : public ::testing::TestWithParam<const char*> {
 protected:
  BestCheckpointRun() {
    for (const std::string id : {"one", "two"}) envs_.push_back(run_.trial.env("summer", {"--id", id}));
    if (learner())
      for (const std::string id : {"a", "b"}) actors_.push_back(run_.actor(id, {"--stay"}));
  }
  bool learner() const { return GetParam() == std::string("learner"); }
  std::unique_ptr<Service> train(int updates, Arguments more = {}) {
    more.insert(more.end(), {"--environments", "2"});
    if (learner()) return run_.learner(updates, more);
    more.insert(more.end(), {"--checkpoint-every", "10"});
    return run_.trial.train(updates, "out", more);
  }
  std::string path(const std::string& name) const { return run_.trial.folder() / ("out/" + name); }
  std::string best() const { return path("checkpoints/best.clk"); }
  Json summary() const { return Json::parse(contents(path("summary.json"))); }
  /// Returns the training SPL by update, from the update on that ended the 100th episode.
  std::map<std::uint64_t, double> spl() const {
    std::map<std::uint64_t, double> found;
    for (const auto& row : run_.metrics())
      if (std::stoi(row.at(2)) >= 100) found[std::stoul(row.at(0))] = std::stod(row.at(7));
    return found;
  }
  /// The best checkpoint is that with the highest SPL, and is named where a user looks.
  void expect_best() const {
    double highest = 0;
    const auto all = spl();
    for (const auto& [update, value] : all)
      if (update % 10 == 0 || update == all.rbegin()->first) highest = std::max(highest, value);
    const Json found = summary()["train"]["best"];
    EXPECT_NEAR(found["spl"].get<double>(), highest, 1e-4);
    EXPECT_EQ(found["checkpoint"], "checkpoints/best.clk");
    EXPECT_EQ(found["chosen_by"], "training");
    const Json progress = read_checkpoint(best()).header["progress"];
    EXPECT_EQ(progress["updates"], found["update"]);
    EXPECT_EQ(progress["spl"], found["spl"]);
  }

  Learning run_{"simulated"};
  std::vector<std::unique_ptr<Service>> envs_, actors_;
};
INSTANTIATE_TEST_SUITE_P(, BestCheckpointRun, ::testing::Values("both", "learner"),
                         [](const auto& tested) { return std::string(tested.param); });

TEST_P(BestCheckpointRun, IsKeptAlsoByARunThatIsKilledAndResumed) {
  const auto killed = train(150);
  ASSERT_TRUE(poll_until([&] { return std::filesystem::exists(best()); }, kWholeRun)) << killed->output();
  ASSERT_EQ(killed->end(SIGKILL, seconds(5)), 128 + SIGKILL) << "it had ended before";
  const auto resumed = train(150, {"--resume"});
  ASSERT_EQ(resumed->wait(kWholeRun), 0) << resumed->output();
  expect_best();

  const auto again = run_.trial.policy({"--mode", "evaluate", "--checkpoint", best(), "--tasks", "16", "--evaluate",
                                        "summer", "--output", run_.trial.folder() / "again"});
  ASSERT_EQ(again->wait(kWholeRun), 0) << again->output();
  // Whoever removes the newest checkpoints goes on from the best one.
  const std::string update = std::to_string(summary()["train"]["best"]["update"].get<int>());
  while (const auto newest = newest_checkpoint(path("checkpoints"))) {
    if (*newest == best()) break;
    std::filesystem::remove(*newest);
  }
  const auto back = train(150, {"--resume"});
  ASSERT_EQ(back->wait(kWholeRun), 0) << back->output();
  EXPECT_TRUE(contains(back->output(), "resuming after update " + update + " ")) << back->output();
}

/// The log and the service's status name a collapse until it is over.
TEST_P(BestCheckpointRun, ACollapseIsAnAlarmUntilTheTrainingHasRecovered) {
  Node listener({run_.trial.middleware(), "listener", "listener", "default"});
  listener.create_reader<msg::ServiceStatus>();
  msg::ServiceStatus status;
  const auto hears = [&](const std::function<bool(const std::string&)>& condition) {
    const auto heard = [&] {
      while (listener.take(status))
        if (status.header().sender() == "policy" && condition(status.alarm().c_str())) return true;
      return false;
    };
    return eventually([&] { listener.wait(Clock::now() + milliseconds(50)); }, heard, kWholeRun);
  };
  const auto before = train(2000);
  ASSERT_TRUE(poll_until([&] { return std::filesystem::exists(best()); }, kWholeRun)) << before->output();
  ASSERT_EQ(before->end(SIGTERM, seconds(5)), 130) << before->output();
  // It goes on as if its last hundred episodes had failed.
  const std::string newest = *newest_checkpoint(path("checkpoints"));
  Checkpoint checkpoint = read_checkpoint(newest);
  Json& progress = checkpoint.header["progress"];
  progress["spl"] = 0.0;
  for (Json& episode : progress["recent"]) episode = {-1.0, 0.0};
  write_checkpoint(newest, checkpoint);
  const auto after = train(2000, {"--resume"});
  ASSERT_TRUE(hears([&](const std::string& alarm) {
    return contains(alarm, "training: SPL fell from ") && contains(alarm, "; " + best() + " is of update ");
  })) << after->output();
  ASSERT_TRUE(hears([](const std::string& alarm) { return alarm.empty(); })) << after->output();
  EXPECT_GE(spl().rbegin()->second, 0.7);
  EXPECT_EQ(occurrences(after->output(), "training: SPL fell from "), 1) << after->output();
  EXPECT_EQ(occurrences(after->output(), "training: the problem is solved"), 1) << after->output();
  EXPECT_EQ(after->end(SIGTERM, seconds(5)), 130) << after->output();
}

TEST_P(BestCheckpointRun, TrainingEndsAtTheSplThatStopWhenSays) {
  const auto stopped = train(100000, {"--stop-when", "0.97"});
  ASSERT_EQ(stopped->wait(kWholeRun), 0) << stopped->output();
  const auto all = spl();
  EXPECT_GE(all.rbegin()->second, 0.97 - 1e-4);
  for (auto row = all.begin(); row != std::prev(all.end()); ++row) EXPECT_LT(row->second, 0.97 + 1e-4) << row->first;
  EXPECT_EQ(run_.trial.checkpoint("out").first, "checkpoint-" + std::to_string(all.rbegin()->first) + ".clk");
  EXPECT_TRUE(summary()["evaluate"].contains("summer"));
  expect_best();
  EXPECT_EQ(Json::parse(contents(path("manifest.json")))["stop_when"], 0.97);
  // It has ended, and does not begin again.
  const auto bytes = run_.trial.checkpoint("out").second;
  const auto again = train(100000, {"--stop-when", "0.97", "--resume"});
  ASSERT_EQ(again->wait(kWholeRun), 0) << again->output();
  EXPECT_EQ(spl(), all);
  EXPECT_TRUE(run_.trial.checkpoint("out").second == bytes);
}

/// An evaluation chooses an update that has no other checkpoint, and disturbs no checkpoint.
TEST(BestCheckpoint, IsChosenByEvaluationsOnOtherTraversals) {
  Trial run("simulated");
  const auto summer = run.env("summer"), winter = run.env("winter");
  const auto without = run.train(60, "without", {"--lockstep"});
  ASSERT_EQ(without->wait(kLongWait), 0) << without->output();
  const auto with = run.train(60, "with", {"--lockstep", "--evaluate-every", "7", "--evaluate", "summer,winter"});
  ASSERT_EQ(with->wait(kLongWait), 0) << with->output();
  EXPECT_TRUE(run.checkpoint("with") == run.checkpoint("without")) << "the final checkpoints differ";
  const Json best = Json::parse(contents(run.folder() / "with/summary.json"))["train"]["best"];
  EXPECT_EQ(best["chosen_by"], "evaluation");
  EXPECT_EQ(best["update"].get<int>() % 7, 0);
  double highest = 0;
  int evaluations = 0;
  for (const std::string& line : lines_of(with->output()))
    if (const auto at = line.find("on 'winter': completed"); at != std::string::npos) {
      ++evaluations;
      highest = std::max(highest, std::stod(line.substr(line.find("SPL ") + 4)));
    }
  EXPECT_EQ(evaluations, 8);
  EXPECT_NEAR(best["spl"].get<double>(), highest, 1e-3);
  const Json header = read_checkpoint(run.folder() / "with/checkpoints/best.clk").header;
  EXPECT_EQ(header["progress"]["updates"], best["update"]);
  EXPECT_EQ(header["evaluation_spl"], best["spl"]);
}

}  // namespace
}  // namespace citylearn::testing
