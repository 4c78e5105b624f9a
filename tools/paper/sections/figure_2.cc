// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/context.h"

namespace citylearn::paper {
namespace {

const std::vector<int> kDimensions = {64, 512, 2048, 4096};

/// Estimated seconds of one training of `features`, on two idle processors.
double training_seconds(int features) { return 60 + 0.04 * features; }

/// The paper's agent on more features than the others compare it on, as many as the data allow.
std::vector<Context::Agent> wide_agents(const Context& context) {
  const auto narrow = std::find_if(context.agents.begin(), context.agents.end(),
                                   [](const Context::Agent& agent) { return agent.agent == "features"; });
  const std::string encoder = narrow->representation.substr(0, narrow->representation.rfind('-') + 1);
  std::vector<Context::Agent> agents;
  for (const std::string& representation : context.world.representations(kDimensions)) {
    Context::Agent agent = *narrow;
    agent.representation = representation;
    const int features = context.features(agent);
    if (!representation.starts_with(encoder) || features <= context.features(*narrow)) continue;
    // Training time grows with the features: fewer seeds.
    agent.seeds.resize(std::min<std::size_t>(agent.seeds.size(), features <= 512 ? 3 : 1));
    agent.seconds = training_seconds(features);
    agents.push_back(agent);
  }
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
      study.traversals = {context.world.train()};
      return unit_of(study, context.world);
    }));
  return {{"agents", agents}};
}

}  // namespace citylearn::paper
