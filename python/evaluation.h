// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "policy_service/network/checkpoint/trained_agent.h"
#include "policy_service/results/score.h"
#include "policy_service/rollout/policy.h"
#include "python/env_group.h"
#include "python/options.h"

namespace citylearn::python {

/// Returns the agent of a checkpoint. Throws Error naming the file.
TrainedAgent load_agent(const std::string& path);

/// Returns the map of a recording.
Streets streets_of(const Recording& recording);
/// Returns whether an agent learned on this map, or on a line where this is one.
bool learned_on(const TrainedAgent& agent, const Streets& streets);

/// Return policies that have decided nothing yet. `seed` is that of policy_service's --seed. Throw Error where an agent
/// of streets is to walk on a line, or the other way round.
/// `reference`: features of the streets, as NetworkTask has them; on a line the agent's own.
std::unique_ptr<Policy> agent_policy(TrainedAgent agent, std::uint64_t seed, const Streets& on,
                                     const Matrix<float>& reference);
/// An agent that was exported as an ONNX model. Throws Error naming the file when it is another model.
struct ExportedPolicy {
  explicit ExportedPolicy(const std::string& path);
  std::string name;
  TrainingData data;                              ///< as TrainedAgent's
  int first_frame = 0, frames = 0, features = 0;  ///< 0 features: it takes none
  int places = 0;                                 ///< as TrainedAgent's
  std::vector<std::byte> model;
  std::map<std::string, int> inputs;  ///< their widths
};
std::unique_ptr<Policy> exported_policy(const ExportedPolicy& policy, std::uint64_t seed, const Streets& on);
/// Throws Error unless an agent that learned on streets of so many places, 0: on a line, walks on such a map.
void require_kind(int places, const Streets& on);
/// `reference`: D x EN, as ControlTask has it; it walks on `recording`. Throws Error when the control or a parameter is
/// unknown.
std::unique_ptr<Policy> control_policy(const std::string& name, const std::map<std::string, double>& parameters,
                                       const Route& route, const Matrix<float>& reference, const Recording& recording);
/// `act` chooses one action per agent from their observations.
using Act = std::function<void(const msg::Observation& seen, std::vector<std::uint8_t>& choice)>;
std::unique_ptr<Policy> function_policy(Act act);

/// Returns the features of the route, D x N. Throws Error when the recording lacks some of its frames.
Matrix<float> reference_of(const Recording& recording, const Route& route);

/// The tasks that policy_service's evaluation with this --seed has.
struct Tasks {
  int count = 2000;
  std::uint64_t seed = 1;
};
/// Performs them by a policy that has decided nothing yet. `interrupt` is called at each step; what it throws ends it.
Score evaluate(Policy& policy, const Recording& recording, const Route& route, const Tasks& tasks,
               const EnvGroup::Interrupt& interrupt);

}  // namespace citylearn::python
