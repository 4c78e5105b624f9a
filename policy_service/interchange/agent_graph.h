// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/plugin/registry.h"
#include "policy_service/interchange/onnx_graph.h"
#include "policy_service/network/checkpoint/trained_agent.h"

namespace citylearn {

/// One step of an agent as an ONNX model: what it observes and its recurrent state in; logits, value and the next state
/// out. An input exists in the model once its exporter has asked for it, so that agents that ignore features (the
/// baseline) have none.
class AgentGraph : public OnnxGraph {
 public:
  /// `agent` must outlive it.
  explicit AgentGraph(const TrainedAgent& agent) : AgentGraph(agent, agent.network->state_size()) {}
  /// `state_size`: of the model, where it has not the state of the network.
  AgentGraph(const TrainedAgent& agent, int state_size);

  OnnxValue features();         ///< batch x D, normalised where the network wants it: see FeatureNormaliser
  OnnxValue goal();             ///< batch x 1, place on the route, 0..N-1
  OnnxValue position();         ///< batch x 1, likewise
  OnnxValue previous_action();  ///< batch x 3, one-hot; zeros where there was none
  OnnxValue allowed();          ///< batch x 3, 1 = allowed
  /// batch x state_size, zeros where an episode begins: already wiped by the input `first`.
  OnnxValue state();
  OnnxValue first();  ///< batch x 1, 1 = first observation of an episode
  /// Adds a linear layer by the names of its tensors.
  OnnxValue layer(const OnnxValue& x, const std::string& weight, const std::string& bias);
  OnnxValue layer(const OnnxValue& x, const std::string& weight);
  /// Returns the network's tensor of that name. Throws Error when it has none: the exporter is of another version.
  Eigen::Map<const Matrix<float>> tensor(const std::string& name) const;
  const TrainedAgent& agent() const { return agent_; }

  /// `heads` (batch x 4): three logits, masked here, and the value. Call it once, at the end.
  void finish(const OnnxValue& heads, const OnnxValue& next_state);

 private:
  OnnxValue known(const std::string& name, std::int64_t width, const std::string& help);
  std::string actions() const;  ///< their names, in order

  const TrainedAgent& agent_;
  int state_size_;
  std::map<std::string, OnnxValue> inputs_;
};

/// Exporters by the name of the network they export: one file each under exporters/, which ends in a static
/// Registration and stands in interchange.cmake. They get the network's own parameters.
using AgentGraphRegistry = Registry<AgentGraph, const TrainedAgent&>;

/// Returns the model of an agent that was built with these parameters. Throws Error when its network has no exporter.
std::unique_ptr<AgentGraph> export_graph(const TrainedAgent& agent, const Parameters& parameters);

}  // namespace citylearn
