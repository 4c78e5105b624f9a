// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/interchange/agent_graph.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn {

/// Adds the layers after the linear layer's sums (batch x hidden), as network/layers/lstm.h: nonlinearity, previous
/// action and mask, LSTM, heads. Uses primitive operators, as readers of ONNX's own LSTM differ in what they support.
inline void export_lstm(AgentGraph& graph, const Parameters& parameters, const OnnxValue& embedded) {
  const int cells = parameters.integer("cells");
  std::vector<OnnxValue> inputs = {parameters.flag("relu") ? relu(embedded) : tanh(embedded), graph.previous_action()};
  if (parameters.flag("mask-input")) inputs.push_back(-1 * graph.allowed() + 1);
  const OnnxValue h = graph.columns(graph.state(), 0, cells), c = graph.columns(graph.state(), cells, 2 * cells);
  const OnnxValue gates =
      graph.layer(graph.concat(inputs), "lstm.input", "lstm.bias") + graph.layer(h, "lstm.recurrent");
  const auto gate = [&](int which) { return graph.columns(gates, which * cells, (which + 1) * cells); };
  const OnnxValue input = sigmoid(gate(0)), forget = sigmoid(gate(1)), output = sigmoid(gate(2));
  const OnnxValue next_c = forget * c + input * tanh(gate(3));
  const OnnxValue next_h = output * tanh(next_c);
  graph.finish(graph.layer(next_h, "heads.weight", "heads.bias"), graph.concat({next_h, next_c}));
}

/// One of so many places or states, moved to -0.5..0.5 and scaled.
inline OnnxValue destination(const OnnxValue& place, int count, double scale) {
  return static_cast<float>(scale) * (1.0f / static_cast<float>(count) * place + -0.5f);
}

}  // namespace citylearn
