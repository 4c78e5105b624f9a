// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/task/lost.h"
#include "env_service/environment.h"
#include "env_service/live/robot.h"

namespace citylearn {

/// Lets the one agent of an environment be a robot, whose steps take time. Used by one thread.
class LiveSteps {
 public:
  /// `environment` must outlive it. Throws Error when it has several agents.
  LiveSteps(Environment& environment, std::unique_ptr<Robot> robot);

  /// Begins anew under settings that the environment has accepted, once the robot has been seen.
  void reset(const msg::TaskSettings& settings);
  /// Begins a step. Throws Error, changing nothing, as Environment::step() does. In an evaluation, a robot that is lost
  /// by `belief` (--max-lost) stays where it is and looks again instead.
  void step(std::span<const std::uint8_t> actions, const msg::Belief& belief);
  /// Ends what has begun: the robot stands.
  void stop();
  /// Refuses goals until the next step: the policy_service has fallen silent.
  void release();

  /// Returns true when what has begun is done: the environment then shows what the robot sees.
  bool advance(Clock::time_point now);
  bool busy() const { return doing_ != Doing::kNothing; }
  /// Returns whether the robot stands until it gets a goal.
  bool awaits_goal() const { return doing_ == Doing::kAwaitGoal; }
  Clock::time_point due() const { return robot_->due(); }
  /// Returns why the robot does not drive on: Robot::trouble(), or that it is lost.
  std::string trouble(Clock::time_point now) const {
    const std::string trouble = robot_->trouble(now);
    return trouble.empty() ? lost_ : trouble;
  }

 private:
  enum class Doing { kNothing, kReset, kStep, kAwaitGoal };

  void take_goals();
  int nearest(int place) const;
  void finish();
  void publish_progress(bool began);
  bool is_lost(const msg::Belief& belief);
  void forget();

  Environment& environment_;
  const std::unique_ptr<Robot> robot_;
  Doing doing_ = Doing::kNothing;
  msg::TaskSettings settings_;         // of the reset
  std::vector<std::uint8_t> actions_;  // of the step
  bool driven_ = false;                // a policy_service lets it drive
  std::string lost_;                   // says that it is; empty: it is not
  LostWatch watch_;                    // of what is believed in the episode
  std::optional<int> goal_;            // to which it was sent, while no episode has begun for it
};

}  // namespace citylearn
