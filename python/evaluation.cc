// SPDX-License-Identifier: Apache-2.0
#include "python/evaluation.h"

#include <utility>

#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/run/evaluation.h"
#include "tools/lab/training.h"

namespace citylearn::python {
namespace {

class FunctionPolicy : public Policy {
 public:
  explicit FunctionPolicy(Act act) : act_(std::move(act)) {}
  void act(const msg::Observation& seen, std::vector<std::uint8_t>& choice) override { act_(seen, choice); }

 private:
  const Act act_;
};

}  // namespace

TrainedAgent load_agent(const std::string& path) { return trained_agent(read_checkpoint(path)); }

std::unique_ptr<Policy> agent_policy(const TrainedAgent& agent, std::uint64_t seed) {
  NetworkPolicy::Options options;
  options.seed = evaluation_choice_seed(seed);
  return std::make_unique<NetworkPolicy>(agent, options);
}

std::unique_ptr<Policy> control_policy(const std::string& name, const std::map<std::string, double>& parameters,
                                       const Route& route, const Matrix<float>& reference, const Recording& recording) {
  const auto& entry = ControlRegistry::instance().find("control", name);
  return entry.create(Parameters("control " + name, entry.parameters, parameters),
                      {.first_frame = route.first_frame,
                       .frames = route.frames,
                       .reference = reference,
                       .streets = recording.traversal.states()});
}

std::unique_ptr<Policy> function_policy(Act act) { return std::make_unique<FunctionPolicy>(std::move(act)); }

Matrix<float> reference_of(const Recording& recording, const Route& route) {
  return network_task(recording.traversal, route.first_frame, route.frames).reference;
}

Score evaluate(Policy& policy, const Recording& recording, const Route& route, const Tasks& tasks,
               const EnvGroup::Interrupt& interrupt) {
  Trial trial;
  trial.first_frame = route.first_frame;
  trial.frames = route.frames;
  trial.max_steps = route.max_steps;
  trial.max_detour = route.max_detour;
  trial.shuffle = route.shuffle;
  trial.tasks = tasks.count;
  trial.seed = evaluation_task_seed(tasks.seed);
  trial.imperfections = recording.imperfections;
  trial.interrupt = interrupt;
  return score(try_out(policy, recording.traversal, trial));
}

}  // namespace citylearn::python
