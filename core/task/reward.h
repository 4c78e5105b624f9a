// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace citylearn {

/// Rewards the steps of one episode (Chancán & Milford, 2020): 1 at the goal, nothing for a step that leads nearer to
/// the goal than the agent ever was since it has this goal, else a cost of 1 / max_steps. The distances alone decide,
/// so the reward is known for goals that no agent had.
class EpisodeReward {
 public:
  /// `distance`: the fewest steps from the start to the goal.
  EpisodeReward(int distance, int max_steps) : distance_(distance), nearest_(distance), max_steps_(max_steps) {}

  /// Returns the reward of the step that leads to a place `distance` steps away from the goal.
  float step(int distance) {
    const bool free = distance < nearest_;
    displace(distance);
    ++steps_;
    return reached() ? 1.0f : free ? 0.0f : -1.0f / static_cast<float>(max_steps_);
  }
  /// Notes that the agent was carried to a place `distance` steps away from the goal. That is no step and has no
  /// reward, and only steps that lead nearer than the nearest place ever are free from then on.
  void displace(int distance) {
    distance_ = distance;
    nearest_ = std::min(nearest_, distance);
  }
  /// Notes that the agent has a new goal, `distance` steps away: as at an episode's start, but steps are counted on.
  void aim(int distance) { distance_ = nearest_ = distance; }
  bool reached() const { return distance_ == 0; }
  bool out_of_steps() const { return steps_ >= max_steps_; }

 private:
  int distance_, nearest_, max_steps_, steps_ = 0;
};

}  // namespace citylearn
