// SPDX-License-Identifier: Apache-2.0
#include "policy_service/rollout/rollout.h"

namespace citylearn {

void Rollout::resize(int feature_dimension, int state_size, int steps, int agents, int sequence_length) {
  sequence = sequence_length;
  inputs.resize(feature_dimension, steps, agents);
  next.resize(feature_dimension, 1, agents);
  states.resize(state_size, sequences());
  const std::size_t columns = static_cast<std::size_t>(steps) * static_cast<std::size_t>(agents);
  for (std::vector<float>* part : {&log_probability, &value, &reward, &final_value, &advantage, &target})
    part->assign(columns, 0.0f);
  action.assign(columns, 0);
  ended.assign(columns, kGoesOn);
  last_value.assign(static_cast<std::size_t>(agents), 0.0f);
}

void Rollout::estimate_advantages(double gamma, double lambda) {
  const std::size_t agents = static_cast<std::size_t>(inputs.agents);
  for (std::size_t agent = 0; agent < agents; ++agent) {
    double next_value = last_value[agent], next_advantage = 0;
    for (std::size_t t = static_cast<std::size_t>(inputs.steps); t-- > 0;) {
      const std::size_t index = t * agents + agent;
      if (ended[index] != kGoesOn) {
        next_value = ended[index] == kTruncated ? final_value[index] : 0;
        next_advantage = 0;
      }
      next_advantage = reward[index] + gamma * next_value - value[index] + gamma * lambda * next_advantage;
      next_value = value[index];
      advantage[index] = static_cast<float>(next_advantage);
      target[index] = static_cast<float>(next_advantage + next_value);
    }
  }
}

}  // namespace citylearn
