// SPDX-License-Identifier: Apache-2.0
// What the paper has no figures of: other routes, cameras, experiences and worlds.
#include <algorithm>

#include "tools/paper/sections/sections.h"
#include "tools/paper/studies/recognition.h"

namespace citylearn::paper {
namespace {

using Agents = std::vector<Context::Agent>;

/// Agents that are trained once and tried on other routes or other recordings of `world`: features and place_filter,
/// both with the learner that needs the fewest episodes.
Agents transfer_agents(const Context& context, World& world) {
  const std::string representation = world.common_representation();
  return {{"features", representation, context.few_seeds(), 60, "relabel"},
          {"place_filter", representation, context.seeds, 1.5, "relabel"}};
}

/// Returns the training on the first `frames` places of the world's traversal learned from.
Study first_training(const Context& context, World& world, const Context::Agent& agent, std::uint64_t seed,
                     int frames) {
  const double share = context.quick ? 0.5 : 1;
  Study study = context.study(agent, seed, world);
  study.frames = frames;
  study.steps = context.share_of_steps(agent, share);
  study.deploy_every = 0;
  study.traversals = {world.train()};
  study.seconds *= share;
  study.save_parameters = true;
  return study;
}

/// A way in which a trained agent learns on the second route.
struct Variant {
  std::string label;
  bool pretrained = true;             ///< begins with the parameters of the first route
  std::vector<std::string> frozen{};  ///< tensors that stay as they were
};

std::vector<Variant> variants_of(const std::string& agent) {
  if (agent == "place_filter")
    return {{"all of it is fine-tuned"},
            {"head learns, filter frozen", true, {"filter"}},
            {"filter learns, head frozen", true, {"head"}},
            {"trained from scratch", false}};
  return {{"all of it is fine-tuned"},
          {"input layer learns, rest frozen", true, {"lstm", "heads", "auxiliary"}},
          {"input layer frozen, rest learns", true, {"sensors"}},
          {"trained from scratch", false}};
}

/// Returns the worlds that policies are compared in, the perfect one first.
std::vector<Imperfections> worlds(bool quick) {
  std::vector<Imperfections> all(1);
  const std::vector<double> shares = quick ? std::vector{0.1} : std::vector{0.05, 0.1, 0.2};
  for (const double share : shares) all.push_back({.slip = share});
  for (const double share : shares) all.push_back({.dropped_frames = share});
  all.push_back({.kidnappings = 1});
  all.push_back({.slip = 0.1, .dropped_frames = 0.1, .kidnappings = 1});
  return all;
}

/// Returns what policies are told of a world: how likely slips and, per step, kidnappings are; empty where neither
/// happens. An episode is taken to be as long as a mean distance, a third of the route. Dropped frames are not told.
std::map<std::string, double> told(const Imperfections& imperfections, int frames) {
  std::map<std::string, double> parameters;
  if (imperfections.slip > 0) parameters["slip"] = imperfections.slip;
  if (imperfections.kidnappings > 0) parameters["kidnap"] = std::min(1.0, 3.0 * imperfections.kidnappings / frames);
  return parameters;
}

}  // namespace

Json plan_longer_routes(const Context& context) {
  World& world = context.world;
  const int most_for_features = context.quick ? 128 : 512;  // beyond so many places `features` would take hours
  const std::string representation = world.common_representation();
  std::vector<int> lengths = {context.frames};
  for (const int frames : {512, world.frames()})
    if (frames > lengths.back() && frames <= world.frames()) lengths.push_back(frames);
  Json routes = Json::array();
  for (const int frames : lengths) {
    Agents agents = {{"place_filter", representation, context.seeds, 2, "relabel"}};
    if (frames <= most_for_features) agents.push_back({"features", representation, context.few_seeds(), 60});
    Json route = context.compare(world, agents, {"blind", "shortest_path", "sequence_filter"}, [&](Study& study) {
      study.frames = frames;
      // Fewer tasks where each takes long. All policies have the same ones.
      if (frames > 256) study.tasks = std::max(10, context.tasks() * 256 / frames);
      // A filter over places costs as much as there are places.
      if (study.agent == "place_filter") study.seconds *= std::max(1.0, frames / 200.0);
      if (study.learner != "ppo" || frames != context.frames) study.deploy_every = 0;  // else as in the other sections
    });
    route["frames"] = frames;
    routes.push_back(route);
  }
  return {{"routes", routes}, {"most_for_features", most_for_features}};
}

Json plan_transfer(const Context& context) {
  World& world = context.world;
  const int frames = std::min(context.frames, world.frames() / 2);  // of each of the two routes
  Json agents = Json::array();
  Study second;
  for (const Context::Agent& agent : transfer_agents(context, world)) {
    const std::vector<Variant> variants = variants_of(agent.agent);
    Json unchanged = Json::array(), trained = Json::array();
    for (const Variant& variant : variants)
      trained.push_back({{"label", variant.label}, {"pretrained", variant.pretrained}, {"units", Json::array()}});
    for (const std::uint64_t seed : agent.seeds) {
      const Study first = first_training(context, world, agent, seed, frames);
      const SavedAgent saved = saved_agent(first, world, context.work);
      context.work.add(unit_of(first, world));
      second = first;
      second.save_parameters = false;
      second.first = frames;
      const double share = context.quick ? 0.25 : 1;
      second.steps = context.share_of_steps(agent, share);
      second.seconds = agent.seconds * share * context.effort;
      second.traversals = world.names();
      unchanged.push_back(context.work.add(transfer_unit(saved, second, world)));
      for (std::size_t i = 0; i < variants.size(); ++i) {
        Study study = second;
        if (variants[i].pretrained) study.initial = saved;
        study.frozen = variants[i].frozen;
        trained[i]["units"].push_back(context.work.add(unit_of(study, world)));
      }
    }
    agents.push_back(
        {{"agent", agent.agent}, {"label", label_of(agent.agent)}, {"unchanged", unchanged}, {"variants", trained}});
  }
  return {{"frames", frames},
          {"agents", agents},
          {"controls", context.add_controls(world, {"blind", "sequence_filter"}, second)}};
}

Json plan_viewpoint(const Context& context) {
  World& straight = context.world.pictures() ? context.world : context.drawn;
  World& world = straight.laterally_shifted();
  const std::string representation = world.common_representation();
  const int frames = std::min(context.frames, world.frames());
  Json shifts = Json::array(), cases = Json::array(), agents = Json::array();
  for (const double shift : straight.lateral_shifts())
    shifts.push_back({{"at", shift}, {"name", straight.shifted_name(shift)}});
  const std::vector<std::string> methods =
      context.quick ? std::vector<std::string>{"nearest"} : std::vector<std::string>{"mlp", "nearest"};
  for (const std::string& method : methods)
    for (const Json& shift : shifts)
      cases.push_back(add_case({representation, method, shift["name"]}, context.work, world));
  Study task;
  for (const Context::Agent& agent : transfer_agents(context, world))
    agents.push_back(context.add_agent(agent, [&](std::uint64_t seed) {
      const Study first = first_training(context, world, agent, seed, frames);
      context.work.add(unit_of(first, world));
      task = first;
      task.traversals = world.names();
      return transfer_unit(saved_agent(first, world, context.work), task, world);
    }));
  return {{"recordings", world.description()},
          {"substitute", &straight != &context.world},
          {"representation", representation},
          {"frames", frames},
          {"tolerance", kPlaceTolerance},
          {"shifts", shifts},
          {"methods", methods},
          {"cases", cases},
          {"agents", agents},
          {"controls", context.add_controls(world, {"blind", "sequence_filter"}, task)}};
}

Json plan_experiences(const Context& context) {
  World& source = context.world.names().size() > 1 ? context.world : context.drawn;
  const bool third = source.names().size() > 2;
  World& world = third ? source : source.mixed();
  const std::string representation = world.common_representation(), second = world.names().at(1);
  Agents agents = {{"place_filter", representation, context.seeds, 2, "relabel"}};
  if (!context.quick) agents.push_back({"features", representation, context.seeds, 60, "relabel"});
  Json variants = Json::array();
  for (const std::vector<std::string>& more : {std::vector<std::string>{}, {second}}) {
    Json variant = context.compare(world, agents, {"sequence_filter"}, [&](Study& study) {
      study.experiences = more;
      study.deploy_every = 0;
    });
    variant["more"] = more;
    variants.push_back(variant);
  }
  return {{"recordings", world.description()},
          {"substitute", &source != &context.world},
          {"simulated", !third},
          {"second", second},
          {"frames", std::min(context.frames, world.frames())},
          {"representation", representation},
          {"variants", variants}};
}

Json plan_imperfect_world(const Context& context) {
  World& world = context.world;
  const std::string representation = world.common_representation();
  std::vector<std::string> traversals = world.names();
  traversals.resize(std::min(kFewTraversals, traversals.size()));
  Json rows = Json::array();
  for (const Imperfections& imperfections : worlds(context.quick)) {
    const auto parameters = told(imperfections, context.frames);
    std::vector<std::string> controls = {"sequence_filter", "blind", "shortest_path"};
    if (!parameters.empty()) controls.push_back("sequence_filter, told");
    Json row = context.compare(world, {{"place_filter", representation, context.seeds, 3, "relabel"}}, controls,
                               [&](Study& study) {
                                 study.deploy_every = 0;
                                 study.traversals = traversals;
                                 study.imperfections = imperfections;
                                 study.network_parameters = parameters;
                               });
    row.update({{"slip", imperfections.slip},
                {"dropped_frames", imperfections.dropped_frames},
                {"kidnappings", imperfections.kidnappings},
                {"told", parameters}});
    rows.push_back(row);
  }
  return {{"traversals", traversals}, {"frames", context.frames}, {"representation", representation}, {"worlds", rows}};
}

}  // namespace citylearn::paper
