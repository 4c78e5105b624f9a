// SPDX-License-Identifier: Apache-2.0
// Recorded trajectories played to a scripted learner in the same process.
#include "tools/record/trajectory_replay.h"

#include <gtest/gtest.h>

#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/recordings.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr std::uint64_t kRecorded = 40, kRoom = 5;
constexpr std::uint32_t kSteps = 4, kFeatures = 2;

msg::Trajectory trajectory(std::uint64_t number) {
  msg::Trajectory t;
  sign(t.header(), "actor", 9, number);
  t.learner("was");
  t.log() = log_position(number, 3);
  t.environment("env");
  t.step(kSteps * (number - 1));
  t.version(number);
  t.feature_dimension(kFeatures);
  t.shown().assign(kSteps + 1, -1);
  for (auto* field : {&t.position(), &t.goal()}) field->assign(kSteps + 1, 1);
  for (auto* field : {&t.previous_action(), &t.first()}) field->assign(kSteps + 1, 0);
  t.allowed().assign(kSteps + 1, 7);
  t.value().assign(kSteps + 1, 0);
  t.features().assign((kSteps + 1) * kFeatures, 0.5f);
  t.action().assign(kSteps, 1);
  for (auto* field : {&t.log_probability(), &t.reward(), &t.final_value()}) field->assign(kSteps, -1);
  t.ended().assign(kSteps, 0);
  return t;
}

void write_recording(const std::string& path) {
  Tape tape(path);
  for (std::uint64_t number = 1; number <= kRecorded; ++number) {
    tape.say(trajectory(number), number);
    if (number % 3 == 0) tape.say(trajectory(number - 1), number);  // sent again
  }
}

Node::Options options(std::uint32_t domain, const std::string& id, const std::string& middleware = "inprocess") {
  return {middleware_options(middleware, domain), id, id, "default"};
}

/// Takes trajectories in their order, `kRoom` at a time, and has version 7.
struct ScriptedLearner {
  explicit ScriptedLearner(const Node::Options& options) : node(options) {
    node.create_writer<msg::TrajectoryAcknowledgement>();
    node.create_reader<msg::Trajectory>();
    node.create_reader<msg::ActorStatus>();
  }
  void say(std::uint32_t steps = kSteps, bool training = true) {
    msg::LearnerInfo info;
    info.training(training);
    info.steps(steps);
    info.feature_dimension(kFeatures);
    info.version(7);
    node.publish(info);
  }
  void spin() {
    node.wait(Clock::now());
    msg::ActorStatus status;
    while (node.take(status)) {
      EXPECT_EQ(status.environments().size(), 0u);
      acknowledge(status.header().sender().c_str(), status.header().incarnation());
    }
    msg::Trajectory t;
    while (node.take(t)) {
      EXPECT_STREQ(t.learner().c_str(), "learner");
      EXPECT_EQ(t.log().stream(), node.incarnation());
      EXPECT_LE(t.log().number(), taken.size() + kRoom) << "there is no room";
      if (t.log().number() == taken.size() + 1) taken.push_back(t);
      acknowledge(t.header().sender().c_str(), t.header().incarnation());
    }
  }
  void acknowledge(const std::string& actor, std::uint64_t incarnation) {
    msg::TrajectoryAcknowledgement message;
    message.writer(actor);
    message.writer_incarnation(incarnation);
    message.number(taken.size());
    message.limit(taken.size() + kRoom);
    node.publish(message);
  }
  Node node;
  std::vector<msg::Trajectory> taken;
};

/// Until the replay is over; false when it never is.
bool play(Node& node, TrajectoryReplay& replay, ScriptedLearner& learner) {
  const auto turn = [&] {
    learner.spin();
    node.wait(std::min(replay.due(), Clock::now() + milliseconds(5)));
  };
  return eventually(
      turn, [&] { return !replay.poll(); }, seconds(60));
}

TEST(TrajectoryReplay, TheLearnerGetsEachOnceInOrderAlthoughMessagesAreLost) {
  const Folder folder;
  write_recording(folder / "a.mcap");
  ScriptedLearner learner(options(40, "learner"));
  learner.say();
  Node node(options(40, "replay", "lossy,drop=0.2,repeat=0.1,seed=2:inprocess"));
  TrajectoryReplay replay(node, {folder / "a.mcap"});
  ASSERT_TRUE(play(node, replay, learner));
  ASSERT_EQ(learner.taken.size(), kRecorded);
  EXPECT_EQ(replay.acknowledged(), kRecorded);
  EXPECT_GT(node.traffic.resent, 0u);
  for (std::uint64_t number = 1; number <= kRecorded; ++number) {
    const msg::Trajectory& t = learner.taken[number - 1];
    EXPECT_EQ(t.step(), kSteps * (number - 1)) << "as recorded";
    EXPECT_EQ(t.version(), std::min<std::uint64_t>(number, 7));
    EXPECT_EQ(t.features(), trajectory(number).features());
  }
}

TEST(TrajectoryReplay, EndsWithTheLearnersTraining) {
  const Folder folder;
  write_recording(folder / "a.mcap");
  ScriptedLearner learner(options(41, "learner"));
  learner.say(kSteps, false);
  Node node(options(41, "replay"));
  TrajectoryReplay replay(node, {folder / "a.mcap"});
  ASSERT_TRUE(play(node, replay, learner));
  EXPECT_TRUE(replay.learner_ended());
  EXPECT_EQ(learner.taken.size(), 0u);
}

TEST(TrajectoryReplay, RefusesWhatDoesNotFit) {
  const Folder folder;
  write_recording(folder / "a.mcap");
  Tape(folder / "none.mcap");
  const auto refusal = [&](std::uint32_t domain, const std::string& file, std::uint32_t steps) {
    ScriptedLearner learner(options(domain, "learner"));
    learner.say(steps);
    Node node(options(domain, "replay"));
    return error_of([&] {
      TrajectoryReplay replay(node, {file});
      play(node, replay, learner);
    });
  };
  EXPECT_EQ(refusal(42, folder / "a.mcap", 8), folder / "a.mcap" + ": has 4 steps a trajectory, the learner wants 8");
  EXPECT_EQ(refusal(43, folder / "none.mcap", kSteps),
            folder / "none.mcap" + ": has no trajectories (record a run of --role learner and --role actor)");
}

}  // namespace
}  // namespace citylearn::testing
