// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"

namespace citylearn::paper {

/// Beyond the paper: agents that learned from one traversal beside agents that learned from two, on those that neither
/// knows.
Json plan_experiences(const Context& context) {
  World& source = context.world.names().size() > 1 ? context.world : context.drawn;
  const bool third = source.names().size() > 2;
  World& world = third ? source : source.mixed();
  const int frames = std::min(context.frames, world.frames());
  const std::string representation = common_representation(world), second = world.names().at(1);
  Json variants = Json::array();
  for (const std::vector<std::string>& more : {std::vector<std::string>{}, {second}}) {
    std::vector<Context::Agent> chosen = {{"place_filter", representation, context.seeds, 2, "relabel"}};
    if (!context.quick) chosen.push_back({"features", representation, context.seeds, 60, "relabel"});
    Json agents = Json::array();
    for (const Context::Agent& agent : chosen)
      agents.push_back(context.add_agent(agent, [&](std::uint64_t seed) {
        Study study = context.study(agent, seed);
        study.experiences = more;
        study.frames = frames;
        study.traversals = world.names();
        study.deploy_every = 0;
        return unit_of(study, world);
      }));
    const ControlStudy control{"", representation, 0, frames, context.tasks(), world.names(), more};
    variants.push_back(
        {{"more", more}, {"agents", agents}, {"controls", context.add_controls(world, {"sequence_filter"}, control)}});
  }
  return {{"recordings", world.description()},
          {"substitute", &source != &context.world},
          {"simulated", !third},
          {"second", second},
          {"frames", frames},
          {"representation", representation},
          {"variants", variants}};
}

}  // namespace citylearn::paper
