// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/transfer_agent.h"

#include <algorithm>

#include "policy_service/learning/trainer.h"

namespace citylearn::paper {

std::vector<Context::Agent> transfer_agents(const Context& context, World& world) {
  const std::string representation = common_representation(world);
  return {{"features", representation, context.few_seeds(), 60, "relabel"},
          {"place_filter", representation, context.seeds, 1.5, "relabel"}};
}

std::string common_representation(World& world) {
  for (const int dimension : {64, 32, 16, 8}) {
    const std::string first = world.representations({dimension}).front();
    if (first != "raw84") return first;
  }
  return world.representations({}).front();
}

std::uint64_t transfer_steps(const Context& context, const Context::Agent& agent, double share) {
  const double all = Trainer::recommended_parameters(agent.agent, agent.learner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * share * context.effort));
}

Study first_training(const Context& context, World& world, const Context::Agent& agent, std::uint64_t seed,
                     int frames) {
  const double share = context.quick ? 0.5 : 1;
  Study study = context.study(agent, seed);
  study.frames = frames;
  study.steps = transfer_steps(context, agent, share);
  study.deploy_every = 0;
  study.traversals = {world.train()};
  study.seconds = agent.seconds * share * context.effort;
  study.save_parameters = true;
  return study;
}

}  // namespace citylearn::paper
