// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/wide_features.h"

namespace citylearn::paper {
namespace {

/// The paper's agent on more features than the others compare it on, as many as the data allow.
std::vector<Context::Agent> wide_agents(const Context& context) {
  const Context::Agent narrow = paper_agent(context);
  const std::string encoder = encoder_of(narrow.representation) + "-";
  std::vector<Context::Agent> agents;
  for (const std::string& representation : context.world.representations(kPaperDimensions))
    if (representation.starts_with(encoder) && features_of(representation) > context.features(narrow))
      agents.push_back(wide_agent(context, representation));
  if (context.quick && agents.size() > 1) agents.erase(agents.begin(), agents.end() - 1);
  return agents;
}

}  // namespace

Json plan_figure_2(const Context& context) {
  Json agents = context.add_agents();
  for (const Context::Agent& agent : wide_agents(context))
    agents.push_back(context.add_agent(agent, [&](std::uint64_t seed) {
      Study study = context.study(agent, seed);
      study.deploy_every = 0;
      return unit_of(study, context.world);
    }));
  return {{"agents", agents}};
}

}  // namespace citylearn::paper
