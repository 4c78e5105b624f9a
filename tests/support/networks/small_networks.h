// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "core/util/random.h"
#include "core/wire/messages.h"
#include "env_service/traversal/traversal.h"
#include "policy_service/network/agent_network.h"
#include "tests/support/networks/small_city.h"

namespace citylearn {

/// Parameters that make a network small enough for tests, and the features a frame that it then takes.
struct SmallNetwork {
  std::map<std::string, double> parameters;
  int features = 5;
  std::ptrdiff_t told = 0;  ///< parameters that no loss changes, the first ones
};

inline SmallNetwork small_network(const std::string& name) {
  if (name == "raw_images") return {{{"hidden", 6}, {"cells", 4}, {"side", 28}, {"maps", 2}}, 28 * 28 * 3};
  if (name == "place_filter") return {{{"units", 5}, {"slip", 0.1}}, 5, 2};  // how much is trusted what it sees
  return {{{"hidden", 6}, {"cells", 4}}};
}

/// A task of 7 places.
inline NetworkTask small_task(int features, int experiences = 1) {
  Random random{1};
  NetworkTask task;
  task.features = features;
  task.frames = 7;
  task.reference.resize(features, task.frames * experiences);
  for (float& value : task.reference.reshaped()) value = static_cast<float>(random.normal());
  task.reference.colwise().normalize();
  return task;
}

/// A task on these streets.
inline NetworkTask street_task(const std::shared_ptr<const StateMap>& streets) {
  Random random{1};
  NetworkTask task{5, streets->states(), {}};
  task.streets = streets;
  task.reference.resize(task.features, task.frames);
  for (float& value : task.reference.reshaped()) value = static_cast<float>(random.normal());
  task.reference.colwise().normalize();
  return task;
}

/// Returns the features of a route whose neighbouring places look alike, a place a column.
inline Matrix<float> route_features(int features, int places, Random& random) {
  Matrix<float> route(features, places);
  Vector<float> look = Vector<float>::Zero(features);
  for (int place = 0; place < places; ++place) {
    for (float& value : look) value = 0.8f * value + 0.6f * static_cast<float>(random.normal());
    route.col(place) = look.normalized();
  }
  return route;
}

/// 3 agents walk at random for 6 steps on the first `frames` places, with episodes that begin in the middle. Half of
/// what they see is disguised. The rest agents at the same place share; with `shared` false nothing is shared.
inline NetworkInputs<double> some_inputs(const NetworkTask& task, int frames, bool shared = true) {
  constexpr int kSteps = 6, kAgents = 3;
  Random random{2};
  NetworkInputs<double> inputs;
  inputs.resize(task.features, kSteps, kAgents);
  inputs.frames = frames;
  for (int t = 0; t < kSteps; ++t)
    for (int b = 0; b < kAgents; ++b) {
      const std::size_t index = static_cast<std::size_t>(t) * kAgents + static_cast<std::size_t>(b);
      const bool first = (t == 0 && b == 0) || (t == 3 && b == 1);
      const int position = static_cast<int>(random.below(frames));
      inputs.first[index] = first;
      inputs.position[index] = position;
      inputs.goal[index] = static_cast<int>(random.below(task.streets ? task.places() : frames));
      inputs.previous_action[index] =
          first ? std::uint8_t{kNoAction} : static_cast<std::uint8_t>(random.below(kActions));
      inputs.allowed[index] = task.streets             ? task.streets->allowed(position)
                              : position == 0          ? 0b011
                              : position == frames - 1 ? 0b101
                                                       : 0b111;
      Vector<double> features = task.reference.col(position).cast<double>();
      const bool disguised = random.below(2);
      for (double& value : features) value += disguised ? 0.1 * random.normal() : 0;
      inputs.see(t * kAgents + b, disguised || !shared ? NetworkInputs<double>::own(task, position) : position,
                 features);
    }
  return inputs;
}

/// Returns the derivative of what `function` returns by a number that it reads, as central differences see it.
template <class Function>
double central_difference(double& number, const Function& function) {
  constexpr double kStep = 1e-5;
  const double kept = number;
  number = kept + kStep;
  const double above = function();
  number = kept - kStep;
  const double below = function();
  number = kept;
  return (above - below) / (2 * kStep);
}

/// The recurrent state of so many agents, in the midst of things.
inline Matrix<double> some_state(const AgentNetwork<double>& network, int agents) {
  Random random{6};
  Matrix<double> state(network.state_size(), agents);
  for (double& value : state.reshaped()) value = random.uniform();
  return state;
}

/// Returns options of a quick training of `agent`.
inline TrainerOptions small_options(const std::string& agent, std::uint64_t seed = 1) {
  TrainerOptions options;
  options.agent = agent;
  options.seed = seed;
  if (agent != "place_filter") options.network_parameters = {{"hidden", 24}, {"cells", 16}};
  if (agent == "raw_images") options.network_parameters = small_network(agent).parameters;
  options.learner_parameters = {{"minibatch", 3}, {"epochs", 2}};
  options.trainer_parameters = {{"segment", 24}, {"sequence", 12}, {"steps", 20000}};
  return options;
}

/// small_city() for a network that takes features of any number, else one of as many; for raw_images with numbers like
/// a picture's.
inline Traversal small_city_for(const std::string& name) {
  if (name != "raw_images") return small_city();
  Traversal city = small_city(16, small_network(name).features);
  for (float& value : city.features) value = 0.5f + 10 * value;
  return city;
}

}  // namespace citylearn
