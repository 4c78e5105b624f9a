#include <algorithm>
#include <cmath>

#include "policy_service/trainer.h"
#include "tools/paper/section.h"

namespace citylearn::paper {
namespace {

int share_of(int tasks, double effort) { return std::max(10, static_cast<int>(std::lround(tasks * effort))); }

}  // namespace

int Context::tasks() const { return share_of(quick ? 500 : 2000, effort); }

int Context::tasks_between() const { return share_of(quick ? 50 : 200, effort); }

std::uint64_t Context::steps(const std::string& agent, const std::string& learner) const {
  if (effort >= 1) return 0;
  const double all = Trainer::recommended_parameters(agent, learner).at("trainer").at("steps");
  return static_cast<std::uint64_t>(std::max(1.0, all * effort));
}

Study Context::study(const Agent& agent, std::uint64_t seed) const {
  Study study;
  study.agent = agent.agent;
  study.representation = agent.representation;
  study.frames = frames;
  study.seed = seed;
  study.steps = steps(agent.agent, study.learner);
  study.seconds = agent.seconds * effort;
  study.deploy_every = 100;
  study.tasks = tasks();
  study.tasks_between = tasks_between();
  study.traversals = world.names();
  return study;
}

std::vector<Json> Context::outcomes(const Agent& agent) const {
  std::vector<Json> all;
  for (const std::uint64_t seed : agent.seeds)
    if (const Json& outcome = work.outcome(unit_of(study(agent, seed), world).spec); !outcome.is_null())
      all.push_back(outcome);
  return all;
}

}  // namespace citylearn::paper
