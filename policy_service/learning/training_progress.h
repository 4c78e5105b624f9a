// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

namespace citylearn {

constexpr int kRecent = 100;  ///< episodes in the running means

/// The progress of training. Changes only in Trainer::update and learn.
struct TrainingProgress {
  std::uint64_t updates = 0, steps = 0, episodes = 0;
  int lesson = 0;                                  ///< of the curriculum, from 0
  double smoothed_reward = 0;                      ///< of finished episodes, as the curriculum sees it
  double reward, spl;                              ///< means over the last 100 episodes; NaN before the first
  double episode_length;                           ///< steps, likewise
  std::optional<std::uint64_t> episodes_to_spl95;  ///< when the mean SPL of the last 100 episodes first reached 0.95
  std::optional<std::uint64_t> steps_to_spl95;
};

}  // namespace citylearn
