// SPDX-License-Identifier: Apache-2.0
// What the paper has no figures of: longer routes, an imperfect world.
#include <algorithm>

#include "tools/paper/sections/sections.h"

namespace citylearn::paper {
namespace {

/// Returns what policies are told of a world: how likely slips and, per step, kidnappings are; empty where neither
/// happens. An episode is taken to be as long as a mean distance, a third of the route. Dropped frames are not told.
std::map<std::string, double> told(const Imperfections& imperfections, int frames) {
  std::map<std::string, double> parameters;
  if (imperfections.slip > 0) parameters["slip"] = imperfections.slip;
  if (imperfections.kidnappings > 0) parameters["kidnap"] = std::min(1.0, 3.0 * imperfections.kidnappings / frames);
  return parameters;
}

/// Returns the worlds that policies are compared in, the perfect one first.
std::vector<Imperfections> worlds(bool quick) {
  std::vector<Imperfections> all(1);
  const std::vector<double> shares = quick ? std::vector{0.1} : std::vector{0.05, 0.1, 0.2};
  for (const double share : shares) all.push_back({.slip = share});
  for (const double share : shares) all.push_back({.dropped_frames = share});
  all.push_back({.kidnappings = 1});
  all.push_back({.slip = 0.1, .dropped_frames = 0.1, .kidnappings = 1});
  return all;
}

}  // namespace

Plan longer_routes(const Context& context) {
  World& world = context.world;
  const int most_for_features = context.quick ? 128 : 512;  // beyond so many places `features` would take hours
  const std::string representation = world.common_representation();
  std::vector<int> lengths = {context.frames};
  for (const int frames : {512, world.frames()})
    if (frames > lengths.back() && frames <= world.frames()) lengths.push_back(frames);
  Plan plan{world, {}, {{"most_for_features", most_for_features}}};
  for (const int frames : lengths) {
    std::vector<Agent> agents = {{"place_filter", representation, context.seeds, 2, "relabel"}};
    if (frames <= most_for_features) agents.push_back({"features", representation, context.few_seeds(), 60});
    plan.points.push_back({agents, {"blind", "shortest_path", "sequence_filter"}, [&context, frames](Study& study) {
                             study.frames = frames;
                             // Fewer tasks where each takes long. All policies have the same ones.
                             if (frames > 256) study.tasks = std::max(10, context.tasks() * 256 / frames);
                             // A filter over places costs as much as there are places.
                             if (study.policy == "place_filter") study.seconds *= std::max(1.0, frames / 200.0);
                             // Else as in the other sections.
                             if (study.learner != "ppo" || frames != context.frames) study.deploy_every = 0;
                           }});
  }
  return plan;
}

Plan imperfect_world(const Context& context) {
  World& world = context.world;
  std::vector<std::string> traversals = world.names();
  traversals.resize(std::min<std::size_t>(3, traversals.size()));  // as each is tried in many worlds
  Plan plan{world, {}, {{"traversals", traversals}}};
  for (const Imperfections& imperfections : worlds(context.quick)) {
    const auto parameters = told(imperfections, context.frames);
    std::vector<std::string> controls = {"sequence_filter", "blind", "shortest_path"};
    if (!parameters.empty()) controls.push_back("sequence_filter, told");
    plan.points.push_back(
        {{{"place_filter", world.common_representation(), context.seeds, 3, "relabel"}}, controls, [=](Study& study) {
           study.deploy_every = 0;
           study.traversals = traversals;
           study.imperfections = imperfections;
           study.parameters = parameters;
         }});
  }
  return plan;
}

}  // namespace citylearn::paper
