// SPDX-License-Identifier: Apache-2.0
#include "policy_service/interchange/agent_graph.h"

#include "policy_service/network/feature_normaliser.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn {

AgentGraph::AgentGraph(const TrainedAgent& agent, int state_size)
    : OnnxGraph(agent.name), agent_(agent), state_size_(state_size) {}

OnnxValue AgentGraph::known(const std::string& name, std::int64_t width, const std::string& help) {
  const auto found = inputs_.find(name);
  if (found != inputs_.end()) return found->second;
  return inputs_[name] = input(name, width, help);
}

OnnxValue AgentGraph::features() {
  const std::int64_t width = agent_.task.features;
  OnnxValue seen = known("features", width, "what is seen: the frame's features, of the encoder it learned with");
  if (!agent_.network->normalises()) return seen;
  const auto found = inputs_.find("normalised");
  if (found != inputs_.end()) return found->second;
  const OnnxValue condition =
      known("condition", width + 1,
            "sums of the features of all frames that agents have seen on this traversal, this one among them, then "
            "their number; zeros: as on the training traversal");
  // Sums and prior by 1 / (their weight): a linear layer each, as readers differ in what they add to a batch.
  const OnnxValue weight =
      exp(-1 * log(columns(condition, width, width + 1) + static_cast<float>(FeatureNormaliser::kPrior)));
  const OnnxValue moved = seen - columns(condition, 0, width) * stretched(weight, width) -
                          linear(weight, "condition.prior", FeatureNormaliser(agent_.task.reference).prior());
  return inputs_["normalised"] = unit_length(moved, width);
}
OnnxValue AgentGraph::goal() {
  return known("goal", 1, "place of the goal on the route, 0 .. frames - 1: the goal's frame less first_frame");
}
OnnxValue AgentGraph::position() {
  return known("position", 1, "place stood at on the route, 0 .. frames - 1: the frame less first_frame");
}
OnnxValue AgentGraph::previous_action() {
  return known("previous_action", kActions, "one-hot " + actions() + "; zeros at an episode's start");
}
OnnxValue AgentGraph::allowed() { return known("allowed", kActions, actions() + ": 1 = allowed, 0 = not"); }
std::string AgentGraph::actions() const {
  return agent_.task.goals > 0 ? "left, forward, right" : "stay, next, previous";
}
OnnxValue AgentGraph::first() {
  return known("first", 1, "1 = first observation of an episode: the state before it is wiped; else 0");
}

OnnxValue AgentGraph::state() {
  const auto found = inputs_.find("wiped");
  if (found != inputs_.end()) return found->second;
  const OnnxValue before = known("state", state_size_, "next_state of the step before; zeros at the very first");
  return inputs_["wiped"] = before * stretched(-1 * first() + 1, state_size_);
}

Eigen::Map<const Matrix<float>> AgentGraph::tensor(const std::string& name) const {
  for (const Tensor& one : agent_.network->tensors())
    if (one.name == name) return {agent_.parameters.data() + one.offset, one.rows, one.cols};
  throw Error("has no tensor '" + name + "'", "network '" + agent_.name + "'", "its ONNX exporter must follow");
}

OnnxValue AgentGraph::layer(const OnnxValue& x, const std::string& weight, const std::string& bias) {
  return linear(x, weight, tensor(weight), bias, tensor(bias));
}
OnnxValue AgentGraph::layer(const OnnxValue& x, const std::string& weight) { return linear(x, weight, tensor(weight)); }

void AgentGraph::finish(const OnnxValue& heads, const OnnxValue& next_state) {
  // Allowed: the logit; not allowed: kMasked. Nothing is lost to rounding in either.
  const OnnxValue logits = columns(heads, 0, kActions) * allowed();
  output("logits", logits + -static_cast<float>(kMasked) * (allowed() + -1), kActions,
         "of " + actions() + "; -1e9 where not allowed. Their softmax is the policy");
  output("value", columns(heads, kActions, kActions + 1), 1, "discounted reward to come, as estimated");
  output("next_state", next_state, state_size_, "to be given as state with the next observation");
}

std::unique_ptr<AgentGraph> export_graph(const TrainedAgent& agent, const Parameters& parameters) {
  const auto entries = AgentGraphRegistry::instance().entries();
  for (const auto* entry : entries)
    if (entry->name == agent.name) return entry->create(parameters, agent);
  throw Error("network '" + agent.name + "' has no ONNX exporter", "",
              "known: " + joined(entries, &AgentGraphRegistry::Entry::name) +
                  "; any network's parameters can leave as safetensors");
}

}  // namespace citylearn
