// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "policy_service/interchange/exporters/places.h"
#include "policy_service/network/layers.h"

namespace citylearn {
namespace {

enum { kFeatureScale, kMaskScale, kPersistence, kFloor, kGoalScale };  // rows of filter.scalars

/// As networks/place_filter.cc.
std::unique_ptr<AgentGraph> export_place_filter(const Parameters&, const TrainedAgent& agent) {
  auto graph = std::make_unique<AgentGraph>(agent);
  const std::ptrdiff_t places = agent.task.frames;
  const auto scalars = graph->tensor("filter.scalars");
  const auto stored = [&](int which) { return kStretch * static_cast<double>(scalars(which, 0)); };
  const auto scale = [&](int which) { return static_cast<float>(std::exp(stored(which))); };
  const auto share = [&](int which) { return static_cast<float>(1 / (1 + std::exp(-stored(which)))); };
  const float floor = share(kFloor), each = 1.0f / static_cast<float>(places);

  // Belief, moved by the previous action; uniform at an episode's start.
  const OnnxValue before = graph->state();
  const OnnxValue previous = graph->previous_action();
  const auto moved_by = [&](int action, const OnnxValue& belief) {
    return graph->stretched(graph->columns(previous, action, action + 1), places) * belief;
  };
  const OnnxValue nothing = 0 * graph->columns(before, 0, 1);
  const OnnxValue forward = graph->concat({nothing, graph->columns(before, 0, places - 1)});
  const OnnxValue back = graph->concat({graph->columns(before, 1, places), nothing});
  Matrix<float> moving(1, kActions);
  moving << 0, 1, 1;
  const OnnxValue stayed = graph->stretched(-1 * graph->linear(previous, "moving", moving) + 1, places) * before;
  const OnnxValue moved =
      stayed + moved_by(kNext, forward) + moved_by(kPrevious, back) + each * graph->stretched(graph->first(), places);
  const OnnxValue log_prior = log((1 - floor) * moved + floor * each);

  // Energies: features, masks (linear in what is allowed), not yet at the goal.
  Matrix<float> mask = Matrix<float>::Constant(places, kActions, 1);  // places x actions: 1 = expected to be allowed
  mask(0, kPrevious) = 0;
  mask(places - 1, kNext) = 0;
  const Matrix<float> mask_weight = scale(kMaskScale) * (2 * mask.array() - 1);
  const Matrix<float> mask_bias = -scale(kMaskScale) * mask.rowwise().sum();
  const PlacesByGoal by_goal = places_by_goal(*graph);
  const OnnxValue similarity = graph->linear(graph->features(), "reference", agent.task.reference.transpose());
  const OnnxValue belief =
      softmax(share(kPersistence) * log_prior + scale(kFeatureScale) * similarity +
              graph->linear(graph->allowed(), "masks.weight", mask_weight, "masks.bias", mask_bias) +
              -scale(kGoalScale) * by_goal.at);

  // Decision head.
  const auto mass = [&](const OnnxValue& where) { return 2 * row_sum(*graph, belief * where, places); };
  OnnxValue layer =
      graph->concat({mass(by_goal.before), mass(by_goal.after), -1 * graph->allowed() + 1, 0.5f * previous});
  layer = tanh(graph->layer(layer, "head.1.weight", "head.1.bias"));
  layer = tanh(graph->layer(layer, "head.2.weight", "head.2.bias"));
  graph->finish(graph->layer(layer, "head.out.weight", "head.out.bias"), belief);
  return graph;
}

const AgentGraphRegistry::Registration place_filter_registration{
    {"place_filter", "as networks/place_filter.cc", {}, export_place_filter}};

}  // namespace
}  // namespace citylearn
