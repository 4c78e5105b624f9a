// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <utility>

#include "env_service/geometry/crossings.h"
#include "tools/paper/sections/sections.h"
#include "tools/paper/studies/map_study.h"

namespace citylearn::paper {
namespace {

/// A row of the table: a policy, and whether it has the junctions.
struct MapPolicy {
  std::string policy;
  bool learns, junctions;
  std::vector<std::uint64_t> seeds;
  double seconds;
};

std::vector<MapPolicy> map_policies(const Context& context) {
  std::vector<MapPolicy> all;
  for (const bool junctions : {true, false}) {
    all.push_back({"place_filter", true, junctions, context.seeds, context.quick ? 8.0 : 20.0});
    all.push_back({"features", true, junctions, context.few_seeds(), context.quick ? 25.0 : 120.0});
    all.push_back({"sequence_filter", false, junctions, {1}, 1});
    all.push_back({"shortest_path", false, junctions, {1}, 1});
  }
  all.push_back({"blind", false, false, {1}, 1});
  return all;
}

/// Returns the recommended number; with --quick a third of it for the slow agent.
std::uint64_t training_steps(const Context& context, const std::string& agent) {
  const std::uint64_t asked = context.steps(agent);
  const double steps =
      asked > 0 ? static_cast<double>(asked) : Trainer::recommended_parameters(agent, "ppo").at("trainer").at("steps");
  return static_cast<std::uint64_t>(context.quick && agent == "features" ? std::max(1.0, steps / 3) : steps);
}

Json json_of(const Layout& layout) {
  const auto [east, north] = metres_of(layout);
  Json json = {{"first", layout.first},
               {"frames", layout.frames},
               {"east", Json::array()},
               {"north", Json::array()},
               {"junctions", junctions_of(layout.turns)}};
  for (const double metres : east) json["east"].push_back(number(metres));
  for (const double metres : north) json["north"].push_back(number(metres));
  return json;
}

}  // namespace

Json plan_map(const Context& context) {
  const int places = context.quick ? 128 : 256;
  Layout layout =
      recorded_layout(context.world.recording(context.world.train()), std::min(places, context.world.frames()));
  const bool drawn = layout.turns.empty();
  World& world = drawn ? context.drawn : context.world;
  if (drawn) layout = drawn_layout(std::min(places, world.frames()));

  MapStudy study;
  study.layout = layout;
  study.representation = world.representations({64}).front();
  study.tasks = context.tasks();
  study.traversals = world.names();
  study.traversals.resize(std::min(kFewTraversals, study.traversals.size()));
  Json policies = Json::array();
  for (const MapPolicy& policy : map_policies(context)) {
    study.policy = policy.policy;
    study.learns = policy.learns;
    study.junctions = policy.junctions;
    study.steps = policy.learns ? training_steps(context, policy.policy) : 0;
    study.seconds = policy.seconds * (policy.learns ? context.effort : 1);
    policies.push_back({{"policy", policy.policy},
                        {"label", label_of(policy.policy)},
                        {"learns", policy.learns},
                        {"junctions", policy.junctions},
                        {"steps", study.steps},
                        {"units", context.add_units(policy.seeds, [&](std::uint64_t seed) {
                           study.seed = seed;
                           return unit_of(study, world);
                         })}});
  }
  return {{"recordings", world.description()},
          {"drawn", drawn},
          {"layout", json_of(layout)},
          {"traversals", study.traversals},
          {"policies", policies}};
}

}  // namespace citylearn::paper
