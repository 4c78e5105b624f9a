#include "tools/paper/beyond.h"

#include <algorithm>

#include "policy_service/trainer.h"

namespace citylearn::paper {

std::vector<Carriage> carriages(const Context& context) {
  const std::size_t most = context.quick ? 1 : 3;
  const std::vector<std::uint64_t> few(
      context.seeds.begin(), context.seeds.begin() + static_cast<std::ptrdiff_t>(std::min(most, context.seeds.size())));
  return {{"features", "features (the paper's)", few, 60}, {"place_filter", "place_filter (ours)", context.seeds, 1.5}};
}

std::string seen_in(World& world) {
  for (const int dimension : {64, 32, 16, 8}) {
    const std::string first = world.representations({dimension}).front();
    if (first != "raw84") return first;
  }
  return world.representations({}).front();
}

std::uint64_t steps_of(const Context& context, const std::string& agent, double share) {
  const double all = Trainer::recommended_parameters(agent, kCarriedLearner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * share * context.effort));
}

Study source_of(const Context& context, World& world, const Carriage& carriage, std::uint64_t seed, int frames) {
  const double share = context.quick ? 0.5 : 1;
  Study study;
  study.agent = carriage.agent;
  study.learner = kCarriedLearner;
  study.representation = seen_in(world);
  study.frames = frames;
  study.seed = seed;
  study.steps = steps_of(context, carriage.agent, share);
  study.tasks = context.tasks();
  study.tasks_between = context.tasks_between();
  study.traversals = {world.train()};
  study.seconds = carriage.seconds * share * context.effort;
  study.keep = true;
  return study;
}

}  // namespace citylearn::paper
