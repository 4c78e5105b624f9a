// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/agents/place_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "policy_service/interchange/agent_graph.h"
#include "policy_service/network/belief/motion.h"
#include "policy_service/network/feature_normaliser.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn {
namespace {

using namespace place_filter;

/// Each place of the route as seen from a goal, batch x N.
struct PlacesByGoal {
  OnnxValue ahead;              ///< goal - place
  OnnxValue before, at, after;  ///< 1 where the place is before, at or after the goal, else 0
};

/// Told by arithmetic, exact for whole numbers: readers differ in which comparisons they know.
PlacesByGoal places_by_goal(AgentGraph& graph, const OnnxValue& goal) {
  const std::ptrdiff_t places = graph.agent().task.frames;
  const Matrix<float> indices = Eigen::VectorXf::LinSpaced(places, 0, static_cast<float>(places - 1));
  PlacesByGoal by;
  by.ahead = graph.linear(goal, "ones", Matrix<float>::Ones(places, 1), "places", -indices);
  by.before = relu(by.ahead) - relu(by.ahead + -1);
  by.after = relu(-1 * by.ahead) - relu(-1 * by.ahead + -1);
  by.at = -1 * (by.before + by.after) + 1;
  return by;
}

/// Returns the sum of each row, batch x 1.
OnnxValue row_sum(AgentGraph& graph, const OnnxValue& x, std::ptrdiff_t width) {
  return graph.linear(x, "sum", Matrix<float>::Ones(1, width));
}

/// Returns how similar each place is to what is seen, batch x N, as PlaceKeys does. Computes the larger of a and b as a
/// + max(b - a, 0).
OnnxValue place_similarity(AgentGraph& graph) {
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

Motion<float> motion_of(AgentGraph& graph, const Parameters& parameters) {
  Motion<float> motion = told_motion<float>(parameters);
  const auto learned = [&](const char* tensor) { return learned_probability(graph.tensor(tensor)(0)); };
  if (learns_slip(parameters)) motion.set(learned("filter.slip"), motion.kidnap());
  if (learns_kidnap(parameters)) motion.set(motion.slip(), std::max(learned("filter.kidnap"), motion.kidnap()));
  return motion;
}

/// Returns the scores `before` (batch x N) after the previous action, as Motion does.
OnnxValue moved_scores(AgentGraph& graph, const Motion<float>& motion, const OnnxValue& before) {
  const std::ptrdiff_t places = graph.agent().task.frames;
  const float slip = motion.slip(), kidnap = motion.kidnap();
  const bool exact = motion.exact();
  const OnnxValue from = exact ? before : softmax(before), previous = graph.previous_action();
  const OnnxValue nothing = 0 * graph.columns(from, 0, 1) + (exact ? kNever : 0);
  const auto done = [&](int action, const OnnxValue& where) {
    return graph.stretched(graph.columns(previous, action, action + 1), places) * where;
  };
  const auto shifted = [&](int action, const OnnxValue& where) {
    return action == kNext ? graph.concat({nothing, graph.columns(where, 0, places - 1)})
                           : graph.concat({graph.columns(where, 1, places), nothing});
  };
  Matrix<float> moving(1, kActions);
  moving << 0, 1, 1;
  OnnxValue moved = graph.stretched(-1 * graph.linear(previous, "moving", moving) + 1, places) * from;
  for (const int action : {kNext, kPrevious}) {
    const OnnxValue once = shifted(action, from);
    if (exact) {
      moved = moved + done(action, once);
      continue;
    }
    const std::ptrdiff_t last = action == kNext ? places - 1 : 0;  // where a second step comes to nothing
    const OnnxValue stays =
        graph.linear(graph.columns(once, last, last + 1), "end", Matrix<float>::Identity(places, places).col(last));
    const OnnxValue slipped = from + shifted(action, once) + stays;
    moved = moved + done(action, (1 - slip) * once + slip / 2 * slipped);
  }
  if (exact) return moved;
  moved = (1 - kidnap) * moved + kidnap / static_cast<float>(places);
  constexpr float kLeast = std::numeric_limits<float>::min();  // has a logarithm
  const OnnxValue impossible = relu(-1 / kNegligible * moved + 1);
  const OnnxValue scores = log(moved + kLeast) + (kNever - std::log(kLeast)) * impossible;
  return graph.stretched(-1 * graph.first() + 1, places) * scores;
}

/// Returns the scores `moved` where the goal is that of the step before, else those of an agent that stands there.
/// `before`: 1 + the goal before, 0 where an episode begins.
OnnxValue scores_at_goal(AgentGraph& graph, const OnnxValue& moved, const OnnxValue& before) {
  const std::ptrdiff_t places = graph.agent().task.frames;
  const OnnxValue apart = graph.goal() - before + 1, known = relu(2 * before + -1) - relu(2 * before + -2);
  const OnnxValue distance = relu(apart) + relu(-1 * apart);
  const OnnxValue arrived = graph.stretched(known * (distance - relu(distance + -1)), places);
  const OnnxValue there = -kExclusion * (-1 * places_by_goal(graph, before + -1).at + 1);
  return moved + arrived * (there - moved);
}

/// Exports what network/agents/place_filter.cc computes. A model's belief is never sparse.
std::unique_ptr<AgentGraph> export_place_filter(const Parameters& parameters, const TrainedAgent& agent) {
  auto graph = std::make_unique<AgentGraph>(agent, agent.task.frames + 2);
  const std::ptrdiff_t places = agent.task.frames;
  const auto scalars = graph->tensor("filter.scalars");
  const auto scalar = [&](int which) {
    return static_cast<float>(std::exp(kStretch * static_cast<double>(scalars(which, 0))));
  };

  // Scores, moved by the previous action; all alike at an episode's start.
  const OnnxValue state = graph->state(), before = graph->columns(state, 0, places);
  const Motion<float> motion = motion_of(*graph, parameters);
  const OnnxValue moved =
      scores_at_goal(*graph, moved_scores(*graph, motion, before), graph->columns(state, places + 1, places + 2));

  // What is seen, and what is excluded: linear in what is allowed (places x actions: 1 = excluded where it is allowed).
  Matrix<float> excluded = Matrix<float>::Zero(places, kActions);
  Matrix<float> otherwise = Matrix<float>::Zero(places, 1);
  const auto only = [&](std::ptrdiff_t end, int action) {
    excluded.col(action).array() -= 1;
    excluded(end, action) += 2;
    otherwise.array() += 1;
    otherwise(end) -= 1;
  };
  only(0, kPrevious);
  only(places - 1, kNext);
  const PlacesByGoal by_goal = places_by_goal(*graph, graph->goal());
  const OnnxValue step = motion.later(0) * (graph->columns(state, places, places + 1) - graph->first() + 1);
  const OnnxValue tempered = exp(-1 * log(scalar(kTempering) * step + 1));
  const OnnxValue similarity = place_similarity(*graph);
  const OnnxValue scores = moved + scalar(kEvidence) * graph->stretched(tempered, places) * similarity +
                           graph->linear(graph->allowed(), "excluded.weight", -kExclusion * excluded, "excluded.bias",
                                         -kExclusion * otherwise) +
                           -kExclusion * by_goal.at;
  const OnnxValue belief = softmax(scores);

  // Decision head.
  const OnnxValue previous = graph->previous_action();
  const auto mass = [&](const OnnxValue& where) { return row_sum(*graph, where, places); };
  const OnnxValue distance = relu(by_goal.ahead) + relu(-1 * by_goal.ahead);
  const OnnxValue weighed = belief * exp(-scalar(kNearness) * log(distance + by_goal.at));
  const auto turning = [&](int action) {  // weight of the side that asks to turn about from it
    return (scalar(kTurning) - 1) * graph->columns(previous, action, action + 1) + 1;
  };
  const OnnxValue sides[] = {mass(weighed * by_goal.before) * turning(kPrevious),
                             mass(weighed * by_goal.after) * turning(kNext)};
  const OnnxValue doubled = exp(-1 * log(sides[0] + sides[1] + std::numeric_limits<float>::min()) + std::log(2.0f));
  std::vector<OnnxValue> inputs = {sides[0] * doubled, sides[1] * doubled};
  for (const OnnxValue& side : {by_goal.before, by_goal.after})
    for (int number = 0; number < kScales; ++number) {
      const auto at_least = [&](float least) { return relu(distance + (1 - least)) - relu(distance + -least); };
      OnnxValue there = at_least(static_cast<float>(1 << number));
      if (number + 1 < kScales) there = there - at_least(static_cast<float>(2 << number));
      inputs.push_back(2 * mass(belief * there * side));
    }
  inputs.insert(inputs.end(), {mass(belief * belief), -1 * graph->allowed() + 1, 0.5f * previous});
  const OnnxValue as_seen = graph->concat(inputs);
  const std::vector<int> mirror = mirrored_inputs(kInputs);
  Matrix<float> exchange = Matrix<float>::Zero(kInputs, kInputs);
  for (int input = 0; input < kInputs; ++input) exchange(input, mirror[static_cast<std::size_t>(input)]) = 1;
  const auto head = [&](const OnnxValue& from) {
    OnnxValue layer = tanh(graph->layer(from, "head.1.weight", "head.1.bias"));
    layer = tanh(graph->layer(layer, "head.2.weight", "head.2.bias"));
    return graph->layer(layer, "head.out.weight", "head.out.bias");
  };
  const OnnxValue both = graph->concat({head(as_seen), head(graph->linear(as_seen, "mirror", exchange))});
  Matrix<float> joined = Matrix<float>::Zero(kActions + 1, 2 * kOutputs);  // logits and value
  joined(kStay, kStaying) = joined(kStay, kOutputs + kStaying) = 0.5f;
  joined(kNext, kWayOn) = joined(kPrevious, kOutputs + kWayOn) = 1;
  joined(kActions, kStateValue) = joined(kActions, kOutputs + kStateValue) = 0.5f;
  const OnnxValue nothing_said = 0 * inputs[0];
  const OnnxValue direct = scalar(kDirectness) * graph->concat({nothing_said, inputs[0], inputs[1], nothing_said});
  graph->finish(graph->linear(both, "joined", joined) + direct, graph->concat({scores, step, graph->goal() + 1}));
  return graph;
}

const AgentGraphRegistry::Registration place_filter_registration{
    {"place_filter", "as networks/place_filter.cc", {}, export_place_filter}};

}  // namespace
}  // namespace citylearn
