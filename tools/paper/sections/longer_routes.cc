// SPDX-License-Identifier: Apache-2.0
#include <algorithm>

#include "tools/paper/sections/transfer_agent.h"

namespace citylearn::paper {
namespace {

std::vector<int> route_lengths(const Context& context) {
  std::vector<int> all = {context.frames};
  for (const int frames : {512, context.world.frames()})
    if (frames > all.back() && frames <= context.world.frames()) all.push_back(frames);
  return all;
}

/// Beyond so many places `features` would take hours.
int most_for_features(const Context& context) { return context.quick ? 128 : 512; }

std::vector<Context::Agent> route_agents(const Context& context, int frames) {
  const std::string representation = common_representation(context.world);
  std::vector<Context::Agent> all = {{"place_filter", representation, context.seeds, 2, "relabel"}};
  if (frames <= most_for_features(context)) all.push_back({"features", representation, context.few_seeds(), 60});
  return all;
}

/// Tasks of a trial: fewer where each takes long. All policies have the same ones.
int tasks(const Context& context, int frames) {
  return frames <= 256 ? context.tasks() : std::max(10, context.tasks() * 256 / frames);
}

Study study_of(const Context& context, const Context::Agent& agent, int frames, std::uint64_t seed) {
  Study study = context.study(agent, seed);
  study.frames = frames;
  study.tasks = tasks(context, frames);
  // A filter over places costs as much as there are places.
  if (agent.agent == "place_filter") study.seconds *= std::max(1.0, frames / 200.0);
  if (agent.learner != "ppo" || frames != context.frames) study.deploy_every = 0;  // else as in the other sections
  return study;
}

}  // namespace

Json plan_longer_routes(const Context& context) {
  World& world = context.world;
  Json routes = Json::array();
  for (const int frames : route_lengths(context)) {
    Json agents = Json::array();
    for (const Context::Agent& agent : route_agents(context, frames))
      agents.push_back(context.add_agent(
          agent, [&](std::uint64_t seed) { return unit_of(study_of(context, agent, frames, seed), world); }));
    const ControlStudy control{"", common_representation(world), 0, frames, tasks(context, frames), world.names()};
    routes.push_back(
        {{"frames", frames},
         {"agents", agents},
         {"controls", context.add_controls(world, {"blind", "shortest_path", "sequence_filter"}, control)}});
  }
  return {{"routes", routes}, {"most_for_features", most_for_features(context)}};
}

}  // namespace citylearn::paper
