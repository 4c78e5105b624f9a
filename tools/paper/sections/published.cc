// SPDX-License-Identifier: Apache-2.0
// What the paper has figures of: trainings, deployments, and its main finding.
#include <algorithm>

#include "tools/paper/sections/sections.h"

namespace citylearn::paper {
namespace {

/// Features a frame that the paper compares.
const std::vector<int> kPaperDimensions = {64, 512, 2048, 4096};
/// Those that the section on them compares.
const std::vector<int> kDimensions = {64, 128, 512, 2048, 4096};

/// The paper's agent on another representation, with fewer seeds where there are more features, as its training takes
/// longer.
Agent wide_agent(const Context& context, const std::string& representation) {
  Agent agent = context.paper_agent();
  const int features = context.world.features(representation);
  agent.representation = representation;
  agent.seeds.resize(std::min<std::size_t>(agent.seeds.size(), features <= 512 ? 3 : 1));
  agent.seconds = 60 + 0.04 * features;  // on two idle processors
  return agent;
}

/// Returns the paper's agent on more features than the others compare it on, as many as the data allow.
std::vector<Agent> wide_agents(const Context& context) {
  World& world = context.world;
  const int narrow = world.features(context.paper_agent().representation);
  std::vector<Agent> agents;
  for (const std::string& representation : world.representations(kPaperDimensions))
    if (world.features(representation) > narrow) agents.push_back(wide_agent(context, representation));
  if (context.quick && agents.size() > 1) agents.erase(agents.begin(), agents.end() - 1);
  return agents;
}

void without_deployments(Study& study) { study.deploy_every = 0; }

}  // namespace

Plan figure_2(const Context& context) {
  Plan plan{context.world, {{context.agents}}};
  for (const Agent& agent : wide_agents(context)) plan.points.push_back({{agent}, {}, without_deployments});
  return plan;
}

Plan figure_7(const Context& context) { return {context.world, {{context.agents}}}; }

Plan figure_8_9(const Context& context) {
  return {context.world, {{context.agents, {"blind", "shortest_path", "sequence_filter"}}}};
}

Plan dimensions(const Context& context) {
  World& world = context.with_pictures();
  const std::string encoder = encoder_of(world.common_representation());
  const int learned_from = world.recording(world.train()).frames;
  // As many features as there can be are tried where this is less than wanted.
  const int most = std::min(world.encoder_dimension(encoder), learned_from - 1);
  std::vector<int> tried, missing;
  for (const int dimension : kDimensions) (dimension <= most ? tried : missing).push_back(dimension);
  if (!missing.empty() && (tried.empty() || tried.back() < most)) tried.push_back(most);
  Plan plan{world,
            {},
            {{"encoder", encoder},
             {"encoder_dimension", world.encoder_dimension(encoder)},
             {"learned_from", learned_from},
             {"missing", missing}},
            &world != &context.world};
  for (const int features : tried) {
    const std::string representation = encoder + "-" + std::to_string(features);
    // What the other sections need too is the same piece of work.
    const bool elsewhere = &world == &context.world && representation == context.paper_agent().representation;
    std::vector<Agent> agents = {{"place_filter", representation, context.seeds, 2 + 0.003 * features, "relabel"}};
    // Quick reports train the paper's agent on the fewest and the most alone.
    if (!context.quick || features == tried.front() || features == tried.back())
      agents.push_back(elsewhere ? context.paper_agent() : wide_agent(context, representation));
    plan.points.push_back({agents, {"sequence_filter", "blind"}, [elsewhere](Study& study) {
                             if (!elsewhere || study.policy != "features") study.deploy_every = 0;
                           }});
  }
  return plan;
}

}  // namespace citylearn::paper
