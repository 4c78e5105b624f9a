// SPDX-License-Identifier: Apache-2.0
// An environment whose agent is a robot.
#include <gtest/gtest.h>

#include "env_service/environment.h"
#include "tests/support/env/env.h"

namespace citylearn::testing {
namespace {

class LiveEnvironment : public ::testing::Test {
 protected:
  LiveEnvironment() { traversal_.dimension = 0; }
  void see(int place, int frame) { environment_.set_robot_pose({place, frame}); }
  void step(std::uint8_t action) { environment_.step(std::span(&action, 1)); }
  const msg::Observation& observe() {
    environment_.observe(seen_);
    return seen_;
  }

  Traversal traversal_ = small_traversal(20);
  Environment environment_{traversal_, 1};
  msg::Observation seen_;
};

TEST_F(LiveEnvironment, EpisodesBeginWhereTheRobotIs) {
  see(7, 20);
  for (const msg::Mode mode : {msg::TRAIN, msg::EVALUATE}) {
    environment_.reset(settings(mode, 20, 100));
    EXPECT_EQ(observe().position()[0], 7u);
    EXPECT_EQ(observe().frame()[0], 20u) << "what its camera took";
    EXPECT_NE(observe().goal()[0], 7u);
    EXPECT_EQ(observe().flags()[0], msg::FLAG_FIRST);
  }
}

TEST_F(LiveEnvironment, StepsLeadWhereTheRobotCame) {
  see(7, 20);
  environment_.reset(settings(msg::TRAIN, 20, 100));
  const int goal = static_cast<int>(observe().goal()[0]), onward = goal > 7 ? 1 : -1;
  const std::uint8_t action = goal > 7 ? kNext : kPrevious;
  EXPECT_EQ(environment_.way(0, action), std::pair(7, 7 + onward));
  EXPECT_EQ(environment_.way(0, kStay), std::pair(7, 7));
  see(7, 21);  // the wheels slipped
  step(action);
  EXPECT_EQ(observe().position()[0], 7u);
  EXPECT_EQ(observe().frame()[0], 21u);
  EXPECT_EQ(observe().reward()[0], -0.01f) << "no nearer";
  see(goal, 22);
  step(action);
  ASSERT_EQ(environment_.finished().size(), 1u);
  EXPECT_TRUE(environment_.finished()[0].completed);
  EXPECT_TRUE(environment_.finished()[0].path.empty()) << "its actions do not say where it went";
  EXPECT_EQ(observe().position()[0], static_cast<std::uint32_t>(goal)) << "the next episode begins there";
}

TEST_F(LiveEnvironment, ARobotBesideTheRouteIsAtItsNearestEnd) {
  msg::TaskSettings part = settings(msg::TRAIN, 5, 100);
  part.first_frame() = 10;
  for (const auto& [place, expected] : {std::pair(3, 10u), {12, 12u}, {19, 14u}}) {
    see(place, 20);
    environment_.reset(part);
    EXPECT_EQ(observe().position()[0], expected);
    EXPECT_EQ(observe().frame()[0], 20u);
  }
}

class SentRobot : public LiveEnvironment {
 protected:
  SentRobot() {
    environment_.use_external_goals();
    see(7, 20);
    tasks_.tasks() = 3;
    environment_.reset(tasks_);
  }
  void send_to(int place) { environment_.set_next_goal(place); }

  msg::TaskSettings tasks_ = settings(msg::EVALUATE, 20, 100);
};

TEST_F(SentRobot, IsIdleUntilItIsSent) {
  EXPECT_EQ(observe().flags()[0], msg::FLAG_IDLE);
  EXPECT_TRUE(environment_.awaits_goal());
  EXPECT_FALSE(environment_.done()) << "tasks are left";
  step(kStay);
  EXPECT_EQ(observe().flags()[0], msg::FLAG_IDLE);
  see(8, 21);  // somebody carries it
  send_to(12);
  step(kStay);
  EXPECT_FALSE(environment_.is_sent()) << "it has begun";
  EXPECT_EQ(observe().flags()[0], msg::FLAG_FIRST);
  EXPECT_EQ(observe().position()[0], 8u);
  EXPECT_EQ(observe().frame()[0], 21u);
  EXPECT_EQ(observe().goal()[0], 12u);
  EXPECT_EQ(observe().previous_action()[0], kNoAction);
}

TEST_F(SentRobot, WaitsForTheNextGoalWhereItArrived) {
  send_to(8);
  step(kStay);
  see(8, 21);
  step(kNext);
  ASSERT_EQ(environment_.finished().size(), 1u);
  EXPECT_TRUE(environment_.finished()[0].completed);
  EXPECT_EQ(environment_.finished()[0].shortest, 1);
  EXPECT_EQ(observe().flags()[0], msg::FLAG_TERMINATED | msg::FLAG_IDLE);
  EXPECT_TRUE(environment_.awaits_goal());
}

TEST_F(SentRobot, ANewGoalCutsTheEpisode) {
  send_to(12);
  step(kStay);
  see(8, 21);
  send_to(3);
  step(kNext);
  ASSERT_EQ(environment_.finished().size(), 1u);
  EXPECT_FALSE(environment_.finished()[0].completed);
  EXPECT_EQ(environment_.finished()[0].goal, 12);
  EXPECT_EQ(observe().flags()[0], msg::FLAG_TRUNCATED | msg::FLAG_FIRST);
  EXPECT_EQ(observe().goal()[0], 3u);
}

TEST_F(SentRobot, IsDoneAfterItsLastTask) {
  int place = 7;
  for (int task = 0; task < 3; ++task) {
    EXPECT_TRUE(environment_.awaits_goal());
    send_to(place + 1);
    step(kStay);
    see(++place, 21 + task);
    step(kNext);
  }
  EXPECT_TRUE(environment_.done());
  EXPECT_FALSE(environment_.awaits_goal());
  send_to(3);
  step(kStay);
  EXPECT_TRUE(environment_.is_sent()) << "kept for what comes next";
  environment_.reset(tasks_);
  EXPECT_EQ(observe().goal()[0], 3u);
  EXPECT_EQ(observe().flags()[0], msg::FLAG_FIRST);
}

TEST_F(SentRobot, GoesToTheNearestPlaceOfItsRoute) {
  msg::TaskSettings part = settings(msg::EVALUATE, 5, 100);
  part.first_frame() = 10;
  send_to(19);
  environment_.reset(part);
  EXPECT_EQ(environment_.goal(0), 14);
}

TEST_F(LiveEnvironment, AForbiddenActionIsRefusedBeforeTheRobotDrives) {
  see(0, 20);
  environment_.reset(settings(msg::TRAIN, 20, 100));
  const std::uint8_t back = kPrevious;
  EXPECT_THROW(environment_.check(std::span(&back, 1)), Error);
}

}  // namespace
}  // namespace citylearn::testing
