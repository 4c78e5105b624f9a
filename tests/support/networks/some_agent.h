// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "policy_service/learning/learner.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/network/checkpoint/checkpoint.h"

namespace citylearn::testing {

inline NetworkTask some_task(int features = 12, int frames = 9, int experiences = 1) {
  Random random{7};
  NetworkTask task;
  task.features = features;
  task.frames = frames;
  task.reference.resize(features, frames * experiences);
  for (float& value : task.reference.reshaped()) value = static_cast<float>(random.normal());
  task.reference.colwise().normalize();
  return task;
}

/// An agent that has learned nothing, its parameters moved so that none is zero and no head is tiny.
inline TrainedAgent some_agent(const std::string& name, const NetworkTask& task,
                               const std::map<std::string, double>& values = {}) {
  const auto& entry = NetworkRegistry<float>::instance().find("network", name);
  TrainedAgent agent;
  agent.name = name;
  agent.task = task;
  agent.first_frame = 5;
  agent.network = entry.create(Parameters(name, entry.parameters, values), task);
  Random random{8};
  agent.network->initialise(random, agent.parameters);
  for (float& value : agent.parameters) value += static_cast<float>(0.05 * random.normal());
  return agent;
}

/// A checkpoint of such an agent, as a trainer writes it before its first update.
inline Checkpoint some_checkpoint(const std::string& name, const NetworkTask& task,
                                  const std::map<std::string, double>& values = {}) {
  TrainerOptions options;
  options.agent = name;
  options.network_parameters = values;
  options.first_frame = 5;
  return Trainer(options, task).checkpoint();
}

}  // namespace citylearn::testing
