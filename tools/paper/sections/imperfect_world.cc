// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"

namespace citylearn::paper {
namespace {

constexpr std::size_t kTraversals = 3;  // the one learned from and two others

/// The worlds that policies are compared in, the perfect one first.
std::vector<Imperfections> worlds(bool quick) {
  std::vector<Imperfections> all(1);
  const std::vector<double> shares = quick ? std::vector{0.1} : std::vector{0.05, 0.1, 0.2};
  for (const double share : shares) all.push_back({.slip = share});
  for (const double share : shares) all.push_back({.dropped_frames = share});
  all.push_back({.kidnappings = 1});
  all.push_back({.slip = 0.1, .dropped_frames = 0.1, .kidnappings = 1});
  return all;
}

/// What policies are told of a world, empty where there is nothing to tell: how likely slips and kidnappings are, these
/// a step. An episode is as long as a mean distance, a third of the route. Nothing can be told of dropped frames.
std::map<std::string, double> told(const Imperfections& imperfections, int frames) {
  std::map<std::string, double> parameters;
  if (imperfections.slip > 0) parameters["slip"] = imperfections.slip;
  if (imperfections.kidnappings > 0) parameters["kidnap"] = std::min(1.0, 3.0 * imperfections.kidnappings / frames);
  return parameters;
}

}  // namespace

/// Beyond the paper: actions slip, frames are dropped and agents are carried elsewhere, in training and in trials.
Json plan_imperfect_world(const Context& context) {
  World& world = context.world;
  const std::string representation = common_representation(world);
  std::vector<std::string> traversals = world.names();
  traversals.resize(std::min(kTraversals, traversals.size()));
  const Context::Agent agent{"place_filter", representation, context.seeds, 3, "relabel"};
  Json rows = Json::array();
  for (const Imperfections& imperfections : worlds(context.quick)) {
    const auto parameters = told(imperfections, context.frames);
    Json agents = Json::array();
    agents.push_back(context.add_agent(agent, [&](std::uint64_t seed) {
      Study study = context.study(agent, seed);
      study.deploy_every = 0;
      study.traversals = traversals;
      study.imperfections = imperfections;
      study.network_parameters = parameters;
      return unit_of(study, world);
    }));
    ControlStudy control{"", representation, 0, context.frames, context.tasks(), traversals};
    control.imperfections = imperfections;
    Json controls = context.add_controls(world, {"sequence_filter", "blind", "shortest_path"}, control);
    if (!parameters.empty()) {
      control.parameters = parameters;
      for (Json& filter : context.add_controls(world, {"sequence_filter"}, control)) {
        filter["label"] = "sequence_filter, told";
        controls.push_back(filter);
      }
    }
    rows.push_back({{"slip", imperfections.slip},
                    {"dropped_frames", imperfections.dropped_frames},
                    {"kidnappings", imperfections.kidnappings},
                    {"told", parameters},
                    {"agents", agents},
                    {"controls", controls}});
  }
  return {{"traversals", traversals}, {"frames", context.frames}, {"representation", representation}, {"worlds", rows}};
}

}  // namespace citylearn::paper
