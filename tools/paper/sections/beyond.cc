// SPDX-License-Identifier: Apache-2.0
// What the paper has no figures of: other routes, cameras, experiences and worlds.
#include <algorithm>

#include "tools/paper/sections/sections.h"
#include "tools/paper/studies/measurements.h"

namespace citylearn::paper {
namespace {

/// Agents that are trained once and tried on other routes or other recordings of `world`: features and place_filter,
/// both with the learner that needs the fewest episodes.
std::vector<Agent> transfer_agents(const Context& context, World& world) {
  const std::string representation = world.common_representation();
  return {{"features", representation, context.few_seeds(), 60, "relabel"},
          {"place_filter", representation, context.seeds, 1.5, "relabel"}};
}

/// Makes a study the training, on the first `frames` places, of an agent that is then tried elsewhere.
void train_first(const Context& context, World& world, int frames, Study& study) {
  const double share = context.quick ? 0.5 : 1;
  study.frames = frames;
  study.steps = context.share_of_steps(study, share);
  study.deploy_every = 0;
  study.traversals = {world.train()};
  study.seconds *= share;
  study.save_parameters = true;
}

/// Makes the training of an agent the trials of that agent.
void try_unchanged(const Context& context, World& world, Study& study) {
  study.initial = saved_agent(study, world, context.work);
  study.kind = Study::Kind::kUnchanged;
  study.traversals = world.names();
}

/// Returns what policies are told of a world: how likely slips and, per step, kidnappings are; empty where neither
/// happens. An episode is taken to be as long as a mean distance, a third of the route. Dropped frames are not told.
std::map<std::string, double> told(const Imperfections& imperfections, int frames) {
  std::map<std::string, double> parameters;
  if (imperfections.slip > 0) parameters["slip"] = imperfections.slip;
  if (imperfections.kidnappings > 0) parameters["kidnap"] = std::min(1.0, 3.0 * imperfections.kidnappings / frames);
  return parameters;
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

/// Ways in which a trained agent learns on the second route, by the tensors that stay as they were.
std::vector<std::pair<std::string, std::vector<std::string>>> trainings_of(const std::string& agent) {
  if (agent == "place_filter")
    return {{"all of it is fine-tuned", {}},
            {"head learns, filter frozen", {"filter"}},
            {"filter learns, head frozen", {"head"}}};
  return {{"all of it is fine-tuned", {}},
          {"input layer learns, rest frozen", {"lstm", "heads", "auxiliary"}},
          {"input layer frozen, rest learns", {"sensors"}}};
}

}  // namespace

Plan longer_routes(const Context& context) {
  World& world = context.world;
  const int most_for_features = context.quick ? 128 : 512;  // beyond so many places `features` would take hours
  const std::string representation = world.common_representation();
  std::vector<int> lengths = {context.frames};
  for (const int frames : {512, world.frames()})
    if (frames > lengths.back() && frames <= world.frames()) lengths.push_back(frames);
  Plan plan{world, {}, {{"most_for_features", most_for_features}}};
  for (const int frames : lengths) {
    std::vector<Agent> agents = {{"place_filter", representation, context.seeds, 2, "relabel"}};
    if (frames <= most_for_features) agents.push_back({"features", representation, context.few_seeds(), 60});
    plan.points.push_back({agents, {"blind", "shortest_path", "sequence_filter"}, [&context, frames](Study& study) {
                             study.frames = frames;
                             // Fewer tasks where each takes long. All policies have the same ones.
                             if (frames > 256) study.tasks = std::max(10, context.tasks() * 256 / frames);
                             // A filter over places costs as much as there are places.
                             if (study.policy == "place_filter") study.seconds *= std::max(1.0, frames / 200.0);
                             // Else as in the other sections.
                             if (study.learner != "ppo" || frames != context.frames) study.deploy_every = 0;
                           }});
  }
  return plan;
}

Plan transfer(const Context& context) {
  World& world = context.world;
  const int frames = std::min(context.frames, world.frames() / 2);  // of each of the two routes
  const auto variants = [&context, &world, frames](const Agent& agent) {
    const auto second = [&context, &world, frames](Study& study) {
      study.seconds *= context.quick ? 0.5 : 1;
      study.steps = context.share_of_steps(study, context.quick ? 0.25 : 1);
      study.save_parameters = false;
      study.first = frames;
      study.traversals = world.names();
    };
    std::vector<Variant> all = {{"", [](Study&) {}, /*shown=*/false},
                                {"unchanged, no training", [&context, &world, second](Study& study) {
                                   try_unchanged(context, world, study);
                                   second(study);
                                 }}};
    for (const auto& [label, frozen] : trainings_of(agent.policy))
      all.push_back({label, [&context, &world, second, frozen](Study& study) {
                       study.initial = saved_agent(study, world, context.work);
                       study.frozen = frozen;
                       second(study);
                     }});
    all.push_back({"trained from scratch", second});
    return all;
  };
  return {world,
          {{transfer_agents(context, world),
            {"blind", "sequence_filter"},
            [&context, &world, frames](Study& study) { train_first(context, world, frames, study); },
            variants}}};
}

Plan viewpoint(const Context& context) {
  World& straight = context.with_pictures();
  World& world = straight.laterally_shifted();
  Json shifts = Json::array(), cases = Json::array();
  for (const double shift : straight.lateral_shifts())
    shifts.push_back({{"at", shift}, {"name", straight.shifted_name(shift)}});
  const std::vector<std::string> methods =
      context.quick ? std::vector<std::string>{"nearest"} : std::vector<std::string>{"mlp", "nearest"};
  for (const std::string& method : methods)
    for (const Json& shift : shifts)
      cases.push_back(add_recognition(world.common_representation(), method, shift["name"], context.work, world));
  const auto variants = [&context, &world](const Agent&) {
    return std::vector<Variant>{{"", [](Study&) {}, /*shown=*/false},
                                {"", [&context, &world](Study& study) { try_unchanged(context, world, study); }}};
  };
  const auto task = [&context, &world](Study& study) { train_first(context, world, study.frames, study); };
  return {world,
          {{transfer_agents(context, world), {"blind", "sequence_filter"}, task, variants}},
          {{"tolerance", kPlaceTolerance}, {"shifts", shifts}, {"methods", methods}, {"cases", cases}},
          &straight != &context.world};
}

Plan experiences(const Context& context) {
  World& source = context.world.names().size() > 1 ? context.world : context.drawn;
  const bool third = source.names().size() > 2;
  World& world = third ? source : source.mixed();
  const std::string representation = world.common_representation(), second = world.names().at(1);
  std::vector<Agent> agents = {{"place_filter", representation, context.seeds, 2, "relabel"}};
  if (!context.quick) agents.push_back({"features", representation, context.seeds, 60, "relabel"});
  Plan plan{world, {}, {{"simulated", !third}, {"second", second}}, &source != &context.world};
  for (const std::vector<std::string>& more : {std::vector<std::string>{}, {second}})
    plan.points.push_back({agents, {"sequence_filter"}, [more](Study& study) {
                             study.experiences = more;
                             study.deploy_every = 0;
                           }});
  return plan;
}

Plan imperfect_world(const Context& context) {
  World& world = context.world;
  const std::vector<std::string> traversals = few_traversals(world);
  Plan plan{world, {}, {{"traversals", traversals}}};
  for (const Imperfections& imperfections : worlds(context.quick)) {
    const auto parameters = told(imperfections, context.frames);
    std::vector<std::string> controls = {"sequence_filter", "blind", "shortest_path"};
    if (!parameters.empty()) controls.push_back("sequence_filter, told");
    plan.points.push_back(
        {{{"place_filter", world.common_representation(), context.seeds, 3, "relabel"}}, controls, [=](Study& study) {
           study.deploy_every = 0;
           study.traversals = traversals;
           study.imperfections = imperfections;
           study.parameters = parameters;
         }});
  }
  return plan;
}

}  // namespace citylearn::paper
