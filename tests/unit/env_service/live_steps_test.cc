// SPDX-License-Identifier: Apache-2.0
// The steps of a robot that a policy_service drives and others send to goals.
#include "env_service/live_steps.h"

#include "core/task/action.h"
#include "tests/unit/env_service/live/robot_fixture.h"

namespace citylearn::testing {
namespace {

/// A robot that a policy_service may drive and others send to goals.
class SentToGoals : public RobotTest {
 protected:
  SentToGoals() {
    RobotOptions with_goals = options();
    with_goals.goal = "/goal";
    steps_.emplace(environment_, std::make_unique<Robot>(with_goals, "robot", own_, taught_, images_));
    tasks_.tasks() = 2;
    send_goal(0);
    EXPECT_FALSE(steps_->advance(Clock::now()));
    EXPECT_EQ(said(), (std::vector<std::string>{"stopped", "refused"})) << "nobody drives it";
  }
  /// The robot is seen at a place, again and again, until what has begun is done.
  void advance(int place) {
    const auto done = [&] {
      send(++now_, kMetres * place);
      return steps_->advance(Clock::now()) || !steps_->busy() || steps_->awaits_goal();
    };
    EXPECT_TRUE(poll_until(done, milliseconds(5000)));
  }
  /// `lost`: the probability of it, as the agent believes.
  void step(std::uint8_t action, float lost = 0, std::uint32_t likeliest = 3) {
    msg::Belief belief;
    belief.likely() = {likeliest, 4, 5, 6, 7, 8, 9, 0};
    belief.probability().assign(msg::LIKELY_PLACES, 0);
    belief.lost() = {lost};
    steps_->step(std::span(&action, 1), belief);
  }

  Environment environment_{taught_, 1};
  std::optional<LiveSteps> steps_;
  msg::TaskSettings tasks_ = settings(msg::EVALUATE, kPlaces, 100);
  double now_ = 10;
};

TEST_F(SentToGoals, EveryGoalIsAnswered) {
  steps_->reset(tasks_);
  send_goal(kMetres * 4);  // before the robot was seen
  send_goal(kMetres * 4);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), std::vector<std::string>{"replaced 4"});
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"driving 6"});
  send_goal(kMetres * 8);
  send_goal(kMetres * 6);
  send_goal(kNan);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), (std::vector<std::string>{"replaced 8", "refused"})) << "6 goes on";
  step(kNext);
  advance(6);
  EXPECT_EQ(said(), (std::vector<std::string>{"arrived 6", "waiting"}));
  step(kStay);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  advance(6);
  EXPECT_EQ(said(), std::vector<std::string>{"arrived 6"}) << "it stands there";
}

TEST_F(SentToGoals, StandsWhileItIsLost) {
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  advance(5);
  commands();
  said();
  step(kNext, 0.75f);
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"lost 6"});
  EXPECT_EQ(
      steps_->trouble(Clock::now()),
      "it is lost and stands: with probability 0.75 it is not near place 3, where it is likeliest (--max-lost 0.7)");
  step(kNext, 0.71875f);
  EXPECT_TRUE(contains(steps_->trouble(Clock::now()), "probability 0.75")) << "one alarm, not one a step";
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>());
  for (const double speed : commands()) EXPECT_EQ(speed, 0);
  msg::Observation seen;
  environment_.observe(seen);
  EXPECT_EQ(seen.previous_action()[0], kStay) << "so the filter knows that it stands";
  step(kNext, 0.25f);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
  advance(6);
  EXPECT_EQ(commands().front(), 100);
  EXPECT_EQ(said(), (std::vector<std::string>{"driving 6", "arrived 6", "waiting"}));
  send_goal(kMetres * 8);
  step(kNext, 0, 8);  // what was believed in the last episode is forgotten
  advance(6);
  step(kNext, 0, 5);
  EXPECT_EQ(steps_->trouble(Clock::now()), "") << "a slip leads there";
  advance(6);
  step(kNext, 0.625f, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()),
            "it was lost and stands: it took itself to be near place 5 and is likeliest near 1 (--max-lost 0.7)");
  advance(6);
  step(kNext, 0.625f, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
  advance(6);
  step(kNext, 0.25f, 8);
  EXPECT_TRUE(contains(steps_->trouble(Clock::now()), "near place 1 and is likeliest near 8")) << "it did not expect 8";
  advance(8);
  tasks_.task_mode() = msg::TRAIN;
  steps_->reset(tasks_);
  send_goal(kMetres * 8);
  advance(5);
  step(kNext, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()), "") << "what it learns from is what it did";
}

TEST_F(SentToGoals, IsNoLongerLostWhenAnEpisodeEnds) {
  tasks_.max_steps() = 1;
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  advance(5);
  step(kNext, 0.75f);
  advance(5);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
}

TEST_F(SentToGoals, GoalsAreRefusedWhenNobodyDrivesOnAndWhenTheTasksAreDone) {
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  steps_->stop();
  EXPECT_EQ(said(), (std::vector<std::string>{"refused", "stopped"}));
  steps_->reset(tasks_);
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"waiting"});
  steps_->release();  // the policy_service is silent
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), (std::vector<std::string>{"stopped", "refused"}));
  step(kStay);  // it is back
  EXPECT_EQ(said(), std::vector<std::string>{"waiting"});
  for (const int goal : {6, 5}) {
    send_goal(kMetres * goal);
    steps_->advance(Clock::now());
    advance(11 - goal);
    step(goal == 6 ? kNext : kPrevious);
    advance(goal);
    if (goal == 6) step(kStay);
  }
  EXPECT_TRUE(environment_.done());
  said();
  send_goal(kMetres * 7);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), std::vector<std::string>{"refused"});
}

}  // namespace
}  // namespace citylearn::testing
