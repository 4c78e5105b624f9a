// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/sections/transfer_agent.h"

#include <algorithm>

#include "policy_service/learning/trainer.h"

namespace citylearn::paper {

std::vector<std::uint64_t> few_seeds(const Context& context) {
  std::vector<std::uint64_t> seeds = context.seeds;
  seeds.resize(std::min<std::size_t>(seeds.size(), context.quick ? 1 : 3));
  return seeds;
}

std::vector<TransferAgent> transfer_agents(const Context& context) {
  return {{"features", "features (the paper's)", few_seeds(context), 60},
          {"place_filter", "place_filter (ours)", context.seeds, 1.5}};
}

std::string common_representation(World& world) {
  for (const int dimension : {64, 32, 16, 8}) {
    const std::string first = world.representations({dimension}).front();
    if (first != "raw84") return first;
  }
  return world.representations({}).front();
}

std::uint64_t transfer_steps(const Context& context, const std::string& agent, double share) {
  const double all = Trainer::recommended_parameters(agent, kTransferLearner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * share * context.effort));
}

Study first_training(const Context& context, World& world, const TransferAgent& agent, std::uint64_t seed, int frames) {
  const double share = context.quick ? 0.5 : 1;
  Study study;
  study.agent = agent.agent;
  study.learner = kTransferLearner;
  study.representation = common_representation(world);
  study.frames = frames;
  study.seed = seed;
  study.steps = transfer_steps(context, agent.agent, share);
  study.tasks = context.tasks();
  study.tasks_between = context.tasks_between();
  study.traversals = {world.train()};
  study.seconds = agent.seconds * share * context.effort;
  study.save_parameters = true;
  return study;
}

}  // namespace citylearn::paper
