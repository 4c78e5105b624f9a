// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/beyond.h"

#include <algorithm>

#include "policy_service/learning/trainer.h"
#include "tools/paper/trials.h"

namespace citylearn::paper {

std::vector<std::uint64_t> few_seeds(const Context& context) { return first_of(context.seeds, context.quick ? 1 : 3); }

std::vector<Carriage> carriages(const Context& context) {
  return {{"features", "features (the paper's)", few_seeds(context), 60},
          {"place_filter", "place_filter (ours)", context.seeds, 1.5}};
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

void judge(Report& report, const std::string& who, const std::string& where, const std::vector<std::string>& recordings,
           const std::vector<Json>& agent, const std::vector<Json>& blind, const std::vector<Json>& filter) {
  std::string lost, behind;
  for (const std::string& name : recordings) {
    const Trials own = trials_on(agent, name);
    const std::string figures =
        name + " (SPL " + fixed(own.spl.mean, 3) + ", completed " + percent(own.completed) + ")";
    if (own.spl.mean <= trials_on(blind, name).spl.mean)
      lost += (lost.empty() ? "" : ", ") + figures;
    else if (worse(own.spl, trials_on(filter, name).spl, 0.01))
      behind += (behind.empty() ? "" : ", ") + figures;
  }
  if (!lost.empty()) report.remark(who + ": no better than one that never looks " + where + " " + lost + ".");
  if (!behind.empty())
    report.remark(who + ": worse than the sequence filter by more than 0.01 SPL " + where + " " + behind + ".");
}

}  // namespace citylearn::paper
