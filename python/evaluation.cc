// SPDX-License-Identifier: Apache-2.0
#include "python/evaluation.h"

#include <utility>

#include "policy_service/network/checkpoint/checkpoint.h"
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

TrainedAgent load_agent(const std::string& path) {
  const Checkpoint checkpoint = read_checkpoint(path);
  TrainedAgent agent = unbuilt_agent(checkpoint);
  return agent.places > 0 ? agent : trained_agent(checkpoint);  // its network is built for the streets it walks on
}

Streets streets_of(const Recording& recording) {
  const Traversal& traversal = recording.traversal;
  return {traversal.states(), traversal.streets ? traversal.streets->hash() : 0};
}

bool learned_on(const TrainedAgent& agent, const Streets& streets) {
  return agent.data.known() ? agent.data.traversals.front().streets_hash == streets.hash
                            : agent.places == (streets.states ? streets.states->places() : 0);
}

void require_kind(int places, const Streets& on) {
  if ((places > 0) == (on.states != nullptr)) return;
  throw Error(places > 0 ? "learned on streets, here is a line" : "learned on a line, here are streets", "policy",
              "choose the recording; ActingPolicy is told the streets by envs=");
}

std::unique_ptr<Policy> agent_policy(TrainedAgent agent, std::uint64_t seed, const Streets& on,
                                     const Matrix<float>& reference) {
  require_kind(agent.places, on);
  if (on.states && reference.cols() % on.states->states() != 0)
    throw Error("learned on other streets", "policy '" + agent.name + "'", "evaluate() knows these by train=");
  if (on.states) agent.build_network(on.states, reference, 0);
  NetworkPolicy::Options options;
  options.seed = evaluation_choice_seed(seed);
  return std::make_unique<NetworkPolicy>(std::move(agent), options);
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
  trial.goals = recording.goals;
  trial.interrupt = interrupt;
  return score(try_out(policy, recording.traversal, trial));
}

}  // namespace citylearn::python
