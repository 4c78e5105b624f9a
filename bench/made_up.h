// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/task/action.h"
#include "core/util/random.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn::bench {

/// Fills inputs with random features, places and goals; one observation in fifty begins an episode. What is in them
/// does not change how long a pass takes.
inline void make_up(NetworkInputs<float>& inputs, const NetworkTask& task, int steps, int agents, Random& random) {
  inputs.resize(task.features, steps, agents);
  inputs.frames = task.frames;
  Vector<float> features(task.features);
  const auto place = [&] { return static_cast<int>(random.below(static_cast<std::uint64_t>(task.frames))); };
  for (int column = 0; column < steps * agents; ++column) {
    const auto i = static_cast<std::size_t>(column);
    for (float& value : features) value = static_cast<float>(random.normal());
    inputs.see(column, -1, features.normalized());
    inputs.position[i] = place();
    inputs.goal[i] = place();
    inputs.first[i] = random.below(50) == 0;
    inputs.previous_action[i] = kStay;
    inputs.allowed[i] = 7;
  }
}

/// Returns a rollout of such observations with random actions and rewards.
inline Rollout made_up_rollout(const NetworkTask& task, int state_size, int steps, int agents, int sequence) {
  Random random{1};
  Rollout rollout;
  rollout.resize(task.features, state_size, steps, agents, sequence);
  rollout.states.setZero();
  make_up(rollout.inputs, task, steps, agents, random);
  make_up(rollout.next, task, rollout.next.steps, rollout.next.agents, random);
  for (std::size_t i = 0; i < rollout.action.size(); ++i) {
    rollout.action[i] = static_cast<std::uint8_t>(random.below(kActions));
    rollout.log_probability[i] = -1.1f;
    rollout.reward[i] = static_cast<float>(random.normal());
  }
  return rollout;
}

}  // namespace citylearn::bench
