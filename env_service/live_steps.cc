// SPDX-License-Identifier: Apache-2.0
#include "env_service/live_steps.h"

#include <utility>

namespace citylearn {

LiveSteps::LiveSteps(Environment& environment, std::unique_ptr<Robot> robot)
    : environment_(environment), robot_(std::move(robot)) {
  if (environment.agents() != 1) throw Error("a robot is one agent", "--agents", "give 1");
  if (!robot_->hears_goals()) return;
  environment.await_goals();
  robot_->tell("stopped");
}

void LiveSteps::reset(const msg::TaskSettings& settings) {
  settings_ = settings;
  doing_ = Doing::kReset;
  driven_ = true;
  robot_->look();
}

void LiveSteps::step(std::span<const std::uint8_t> actions) {
  environment_.check(actions);
  actions_.assign(actions.begin(), actions.end());
  doing_ = environment_.awaits_goal() ? Doing::kAwaitGoal : Doing::kStep;
  if (doing_ == Doing::kAwaitGoal) return;
  const std::uint8_t action = actions_.front();
  if (action == kNoAction) return;  // it waits, and sees what it saw
  const auto [from, to] = environment_.way(0, action);
  robot_->drive(action, from, to);
}

void LiveSteps::stop() {
  doing_ = Doing::kNothing;
  driven_ = false;
  goal_.reset();
  robot_->stop();
  if (robot_->hears_goals()) robot_->tell("stopped");
}

bool LiveSteps::advance(Clock::time_point now) {
  const auto seen = robot_->poll(now);
  take_goal();
  if (doing_ == Doing::kAwaitGoal && goal_) {
    doing_ = Doing::kStep;
    robot_->look();  // it may have been carried elsewhere
    return false;
  }
  const bool waits = doing_ == Doing::kStep && actions_.front() == kNoAction && !environment_.awaits_goal();
  if (!busy() || awaits_goal() || (!seen && !waits)) return false;
  if (seen) environment_.sight(*seen);
  if (goal_ && seen && environment_.awaits_goal() && environment_.nearest(seen->place) == *goal_) {
    robot_->tell("arrived " + std::to_string(*goal_));  // it stands there
    goal_.reset();
    if (doing_ == Doing::kStep) {
      doing_ = Doing::kAwaitGoal;
      return false;
    }
  }
  finish();
  return true;
}

/// Does in the environment what the robot has done.
void LiveSteps::finish() {
  bool began = environment_.awaits_goal();
  environment_.send_to(goal_);
  if (std::exchange(doing_, Doing::kNothing) == Doing::kReset) {
    environment_.reset(settings_);
    began = true;
  } else {
    environment_.step(actions_);
  }
  if (!environment_.is_sent()) goal_.reset();
  environment_.send_to(std::nullopt);
  if (robot_->hears_goals()) tell(began);
}

/// Hears where the robot is sent.
void LiveSteps::take_goal() {
  const auto sent = robot_->take_goal();
  if (!sent) return;
  if (!driven_) return robot_->refuse_goal("no policy_service drives the robot");
  const int goal = environment_.nearest(*sent);
  const bool idle = environment_.awaits_goal() || environment_.done();
  const bool under_way = !goal_ && !idle && environment_.goal(0) == goal;
  if (!under_way) goal_ = goal;
}

/// Tells what became of the robot's goals. `began`: where an episode is under way, it has just begun.
void LiveSteps::tell(bool began) {
  for (const Environment::Episode& episode : environment_.finished()) {
    const bool out_of_steps = episode.steps >= static_cast<int>(settings_.max_steps());
    const char* end = episode.completed ? "arrived " : out_of_steps ? "failed " : "replaced ";
    robot_->tell(end + std::to_string(episode.goal));
  }
  if (environment_.awaits_goal())
    robot_->tell("waiting");
  else if (!environment_.done() && (began || !environment_.finished().empty()))
    robot_->tell("driving " + std::to_string(environment_.goal(0)));
}

}  // namespace citylearn
