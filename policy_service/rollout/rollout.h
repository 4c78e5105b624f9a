// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Data of A agents over T steps, as tensors. Column t * A + a is agent a at step t. A sequence is `sequence` (L)
/// successive steps of one agent; T is a multiple of L, and sequence s of agent a has index s * A + a.
struct Rollout {
  enum Ended : std::uint8_t { kGoesOn = 0, kTerminated = 1, kTruncated = 2 };

  int sequence = 0;                    ///< L
  int max_steps = 0;                   ///< step limit of an episode
  int max_detour = 0;                  ///< likewise, in multiples of its fewest steps; 0: none
  float step_cost = 0;                 ///< what the learner is told that a costly step costs; 0: what the reward says
  NetworkInputs<float> inputs;         ///< T, A and what was seen
  NetworkInputs<float> next;           ///< one step: what was seen after the last action
  Matrix<float> states;                ///< state_size x sequences: the recurrent state before each sequence
  std::vector<std::uint8_t> action;    ///< TA, taken
  std::vector<float> log_probability;  ///< TA, of the action when it was taken
  std::vector<float> value;            ///< TA, of the observation, as estimated then
  std::vector<float> reward;           ///< TA, of the action
  std::vector<std::uint8_t> ended;     ///< TA, Ended by the action
  std::vector<float> final_value;      ///< TA, where truncated: value of the observation that would have followed
  std::vector<float> last_value;  ///< A, value of the observation after the last action, where the episode continues
  std::vector<float> advantage, target;  ///< TA, see estimate_advantages

  void resize(int feature_dimension, int state_size, int steps, int agents, int sequence_length);
  /// Returns the step limit of an episode of so many fewest steps.
  int limit(int fewest) const {
    if (max_detour == 0) return max_steps;
    return static_cast<int>(std::min<std::int64_t>(max_steps, std::int64_t{max_detour} * fewest));
  }
  /// Returns what a learner learns from instead of a step's reward.
  float learned(float given) const { return given < 0 && step_cost > 0 ? -step_cost : given; }
  int sequences() const { return inputs.steps / sequence * inputs.agents; }

  /// Fills in generalised advantage estimates (Schulman et al., 2016) and the values' targets, advantage + value. A
  /// truncated episode continues with `final_value`.
  void estimate_advantages(double gamma, double lambda);
};

}  // namespace citylearn
