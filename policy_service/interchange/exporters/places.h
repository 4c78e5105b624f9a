// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "policy_service/interchange/agent_graph.h"
#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

/// Each place of the route as seen from the goal, batch x N.
struct PlacesByGoal {
  OnnxValue ahead;              ///< goal - place
  OnnxValue before, at, after;  ///< 1 where the place is before, at or after the goal, else 0
};

/// Told by arithmetic, exact for whole numbers: readers differ in which comparisons they know.
inline PlacesByGoal places_by_goal(AgentGraph& graph) {
  const std::ptrdiff_t places = graph.agent().task.frames;
  const Matrix<float> indices = Eigen::VectorXf::LinSpaced(places, 0, static_cast<float>(places - 1));
  PlacesByGoal by;
  by.ahead = graph.linear(graph.goal(), "ones", Matrix<float>::Ones(places, 1), "places", -indices);
  by.before = relu(by.ahead) - relu(by.ahead + -1);
  by.after = relu(-1 * by.ahead) - relu(-1 * by.ahead + -1);
  by.at = -1 * (by.before + by.after) + 1;
  return by;
}

/// Returns the sum of each row, batch x 1.
inline OnnxValue row_sum(AgentGraph& graph, const OnnxValue& x, std::ptrdiff_t width) {
  return graph.linear(x, "sum", Matrix<float>::Ones(1, width));
}

/// Returns how similar each place is to what is seen, batch x N, as PlaceKeys does. Computes the larger of a and b as a
/// + max(b - a, 0).
inline OnnxValue place_similarity(AgentGraph& graph) {
  const NetworkTask& task = graph.agent().task;
  const Matrix<float> keys = normalised_reference(task.reference, task.frames);
  const auto of_experience = [&](std::ptrdiff_t first) {
    return graph.linear(graph.features(), "reference", keys.middleCols(first, task.frames).transpose());
  };
  OnnxValue most = of_experience(0);
  for (std::ptrdiff_t first = task.frames; first < keys.cols(); first += task.frames)
    most = most + relu(of_experience(first) - most);
  return most;
}

}  // namespace citylearn
