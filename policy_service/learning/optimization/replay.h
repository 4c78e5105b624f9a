// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/util/error.h"
#include "policy_service/learning/learner.h"
#include "policy_service/learning/optimization/sequences.h"

namespace citylearn {

/// Keeps the last sequences of all agents, without their goals: what was seen, where, and what was done. Holds `steps`
/// steps, 4 D + 19 bytes each for features of D numbers, allocated at the first add().
class Replay {
 public:
  explicit Replay(std::size_t steps) : steps_(steps) {}

  /// Takes in all sequences of the rollouts, over the oldest ones. Those of another number of places are dropped: they
  /// belong to another lesson.
  void add(std::span<Rollout* const> rollouts);

  std::size_t size() const { return size_; }                           ///< sequences
  int sequence() const { return sequence_; }                           ///< L
  int frames() const { return frames_; }                               ///< N
  int max_steps() const { return max_steps_; }                         ///< of the episodes
  int features() const { return static_cast<int>(features_.rows()); }  ///< D

  /// Returns the index of step t of sequence `slot`, 0 <= t <= L; the last has no action.
  std::size_t at(std::size_t slot, int t) const {
    return slot * static_cast<std::size_t>(sequence_ + 1) + static_cast<std::size_t>(t);
  }
  auto seen(std::size_t at) const { return features_.col(static_cast<std::ptrdiff_t>(at)); }
  int shown(std::size_t at) const { return shown_[at]; }
  int position(std::size_t at) const { return position_[at]; }
  std::uint8_t allowed(std::size_t at) const { return allowed_[at]; }
  std::uint8_t action(std::size_t at) const { return action_[at]; }
  std::uint8_t ended(std::size_t at) const { return ended_[at]; }
  float log_probability(std::size_t at) const { return log_probability_[at]; }

  void save(LearnerState& state) const;
  /// Throws Error, changing nothing, unless `state` has a replay that fits the task. `owner` is for the message.
  void check(const LearnerState& state, const std::string& owner, const NetworkTask& task) const;
  /// Loads a state that passed check().
  void load(const LearnerState& state, int features);

 private:
  static constexpr int kNumbers = 6;  // of a step, beside the features
  static constexpr std::uint64_t kMaxSteps = 1u << 30;

  std::size_t slots(int sequence) const {
    return std::max<std::size_t>(1, steps_ / static_cast<std::size_t>(sequence));
  }

  void make_room(std::ptrdiff_t features, int sequence);
  void add(const Track& track);

  const std::size_t steps_;
  std::size_t size_ = 0, next_ = 0;  // sequences
  int sequence_ = 0, frames_ = 0, max_steps_ = 0;
  Matrix<float> features_;
  std::vector<int> shown_, position_;
  std::vector<std::uint8_t> allowed_, action_, ended_;
  std::vector<float> log_probability_;
};

}  // namespace citylearn
