// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "policy_service/interchange/exporters/lstm.h"
#include "policy_service/interchange/exporters/places.h"

namespace citylearn {
namespace {

/// Exports what network/agents/place_memory.cc computes.
std::unique_ptr<AgentGraph> export_place_memory(const Parameters& parameters, const TrainedAgent& agent) {
  auto graph = std::make_unique<AgentGraph>(agent);
  const std::ptrdiff_t places = agent.task.frames;
  const auto sharpness = static_cast<double>(graph->tensor("attention.sharpness")(0, 0));
  const OnnxValue attention = softmax(static_cast<float>(std::exp(kStretch * sharpness)) * place_similarity(*graph));
  const PlacesByGoal by_goal = places_by_goal(*graph);
  const auto expected = [&](const OnnxValue& what) { return row_sum(*graph, attention * what, places); };
  const Matrix<float> indices = Eigen::RowVectorXf::LinSpaced(places, 0, static_cast<float>(places - 1));
  const Matrix<float> where = 4 * (indices.array() / static_cast<float>(places) - 0.5f);
  const OnnxValue sensed =
      graph->concat({graph->linear(attention, "where", where), 2 * expected(tanh(0.125f * by_goal.ahead)),
                     2 * expected(by_goal.before), 2 * expected(by_goal.after), expected(attention),
                     destination(graph->goal(), agent.task.frames, 4)});
  export_lstm(*graph, parameters, graph->layer(sensed, "sensors.weight", "sensors.bias"));
  return graph;
}

const AgentGraphRegistry::Registration place_memory_registration{
    {"place_memory", "as networks/place_memory.cc", {}, export_place_memory}};

}  // namespace
}  // namespace citylearn
