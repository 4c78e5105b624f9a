#include "tools/paper/section.h"

namespace citylearn::paper {

Study Context::study(const Agent& agent, std::uint64_t seed) const {
  Study study;
  study.agent = agent.agent;
  study.representation = agent.representation;
  study.frames = frames;
  study.seed = seed;
  study.seconds = agent.seconds;
  study.deploy_every = 100;
  study.tasks = quick ? 500 : 2000;
  study.tasks_between = quick ? 50 : 200;
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
