// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/util/random.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn::testing {

/// Describes what some agents might have seen and done.
struct RandomRollout {
  std::uint64_t number = 0;  ///< no two alike
  int agents = 3, steps = 24, sequence = 12;
  float log_probability = -1;  ///< of the actions, about; -infinity: impossible by now
};

/// Returns a rollout of agents that act at random on the route of `task` and see its reference; episodes end both ways.
inline Rollout random_rollout(const NetworkTask& task, int state_size, const RandomRollout& how) {
  Random random{how.number, 77};
  Rollout rollout;
  rollout.resize(task.features, state_size, how.steps, how.agents, how.sequence);
  for (float& value : rollout.states.reshaped()) value = static_cast<float>(random.uniform()) - 0.5f;
  rollout.max_steps = 16;
  rollout.inputs.frames = rollout.next.frames = task.frames;
  const auto places = static_cast<std::uint64_t>(task.frames);
  for (int agent = 0; agent < how.agents; ++agent) {
    int position = static_cast<int>(random.below(places)), goal = 0;
    std::uint8_t previous = kNoAction;
    for (int t = 0; t <= how.steps; ++t) {
      NetworkInputs<float>& inputs = t < how.steps ? rollout.inputs : rollout.next;
      const std::ptrdiff_t column = t < how.steps ? t * how.agents + agent : agent;
      const auto i = static_cast<std::size_t>(column);
      const bool first = previous == kNoAction;
      if (first) goal = (position + 1 + static_cast<int>(random.below(places - 1))) % task.frames;
      inputs.see(column, position, task.reference.col(position));
      inputs.position[i] = position;
      inputs.goal[i] = goal;
      inputs.first[i] = first;
      inputs.previous_action[i] = previous;
      inputs.allowed[i] =
          static_cast<std::uint8_t>(1 | (position < task.frames - 1) << kNext | (position > 0) << kPrevious);
      if (t == how.steps) break;
      std::uint8_t action = kStay;
      do action = static_cast<std::uint8_t>(random.below(kActions));
      while (!(inputs.allowed[i] >> action & 1));
      position += action == kNext ? 1 : action == kPrevious ? -1 : 0;
      const bool reached = position == goal, cut = !reached && random.below(16) == 0;
      rollout.action[i] = action;
      rollout.log_probability[i] = how.log_probability * static_cast<float>(0.5 + random.uniform());
      rollout.value[i] = 0.1f * static_cast<float>(random.normal());
      rollout.reward[i] = reached ? 1.0f : -1.0f / 16;
      rollout.ended[i] = reached ? Rollout::kTerminated : cut ? Rollout::kTruncated : Rollout::kGoesOn;
      rollout.final_value[i] = cut ? 0.2f : 0.0f;
      previous = reached || cut ? std::uint8_t{kNoAction} : action;
    }
    rollout.last_value[static_cast<std::size_t>(agent)] = 0.25f;
  }
  return rollout;
}

}  // namespace citylearn::testing
