// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdlib>

namespace citylearn {

/// The task's reward for an episode from `start` to `goal`, places on the route: it depends on the places alone, so
/// that it is known for goals that nobody had. (The rule itself is the environment's; a test holds both together.)
class GoalReward {
 public:
  GoalReward(int start, int goal, int max_steps)
      : place_(start), goal_(goal), nearest_(std::abs(goal - start)), max_steps_(max_steps) {}

  /// Of the step that leads to `place`: 1 at the goal, nothing when it is nearer than ever before, else a cost.
  float step(int place) {
    const int before = std::abs(goal_ - place_), after = std::abs(goal_ - place);
    place_ = place;
    ++steps_;
    const bool free = after < before && before <= nearest_;
    if (free) --nearest_;
    return after == 0 ? 1.0f : free ? 0.0f : -1.0f / static_cast<float>(max_steps_);
  }
  bool reached() const { return place_ == goal_; }
  bool out_of_steps() const { return steps_ >= max_steps_; }

 private:
  int place_, goal_, nearest_, max_steps_, steps_ = 0;
};

}  // namespace citylearn
