// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/map_study.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstdlib>

#include "core/task/route_map.h"
#include "core/task/spl.h"
#include "env_service/geometry/crossings.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "tools/lab/training.h"
#include "tools/paper/studies/statistics.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

using Episode = Environment::Episode;

/// Returns the stretch as a traversal of its own, with its junctions on request.
Traversal cut_out(const Traversal& whole, const Layout& layout, bool junctions) {
  Traversal part = whole;
  const auto dimension = static_cast<std::ptrdiff_t>(part.dimension);
  const auto first = static_cast<std::ptrdiff_t>(layout.first), end = first + layout.frames;
  if (end > whole.frames)
    throw Error("has " + std::to_string(whole.frames) + " frames, the map ends at " + std::to_string(end),
                "traversal '" + whole.name + "'");
  part.frames = layout.frames;
  part.features.assign(whole.features.begin() + first * dimension, whole.features.begin() + end * dimension);
  part.positions.assign(whole.positions.begin() + first, whole.positions.begin() + end);
  part.times.clear();
  part.latitude = layout.latitude;
  part.longitude = layout.longitude;
  part.turns = junctions ? layout.turns : std::vector<int>();
  return part;
}

/// Shortest paths with junctions.
class Map {
 public:
  explicit Map(const Layout& layout) : layout_(layout), distances_(static_cast<std::size_t>(layout.frames)) {}
  int shortest(const Episode& episode) {
    std::vector<int>& distances = distances_[static_cast<std::size_t>(episode.goal)];
    if (distances.empty()) distances_to(episode.goal, layout_.frames, layout_.turns, distances);
    return distances[static_cast<std::size_t>(episode.start)];
  }
  double spl(const Episode& episode) { return spl_of(episode.completed, shortest(episode), episode.steps); }
  int saved(const Episode& episode) { return std::abs(episode.goal - episode.start) - shortest(episode); }

 private:
  const Layout& layout_;
  std::vector<std::vector<int>> distances_;  ///< by goal
};

Json as_json(const Estimate& estimate) {
  return {{"mean", number(estimate.mean)},
          {"low", number(estimate.low)},
          {"high", number(estimate.high)},
          {"n", estimate.n}};
}

Json trial(const std::vector<Episode>& episodes, Map& map) {
  std::vector<double> spl, steps, shortest;
  double completed = 0;
  for (const Episode& episode : episodes) {
    completed += episode.completed;
    spl.push_back(map.spl(episode));
    steps.push_back(episode.steps);
    shortest.push_back(episode.shortest);
  }
  return {{"completed", as_json(of_share(completed, static_cast<int>(episodes.size())))},
          {"spl", as_json(of_mean(spl))},
          {"steps", as_json(of_mean(steps))},
          {"shortest", as_json(of_mean(shortest))}};
}

Json walk(const std::vector<Episode>& episodes, const Traversal& route, Map& map) {
  const Episode* most = &episodes.front();
  for (const Episode& episode : episodes)
    if (map.saved(episode) > map.saved(*most)) most = &episode;
  return {{"start", most->start},
          {"goal", most->goal},
          {"places", places_walked(most->start, most->steps, most->path, route.turns, route.frames)}};
}

/// Tries a fresh policy on each traversal; the first one is learned from.
template <class Make>
Json tried(const MapStudy& study, World& world, Make make) {
  Map map(study.layout);
  Json outcome = {{"trials", Json::array()}};
  for (const std::string& name : study.traversals) {
    const Traversal route = cut_out(world.traversal(study.representation, name), study.layout, study.junctions);
    Trial how;
    how.frames = how.max_steps = study.layout.frames;
    how.tasks = study.tasks;
    how.interrupt = throw_if_stopped;
    const std::vector<Episode> episodes = try_out(*make(), route, how);
    Json row = trial(episodes, map);
    row["traversal"] = name;
    outcome["trials"].push_back(std::move(row));
    if (name == study.traversals.front()) outcome["walk"] = walk(episodes, route, map);
  }
  return outcome;
}

Json train(const MapStudy& study, World& world) {
  const Traversal route = cut_out(world.traversal(study.representation, world.train()), study.layout, study.junctions);
  TrainerOptions options;
  options.agent = study.policy;
  options.seed = study.seed;
  options.trainer_parameters["steps"] = static_cast<double>(study.steps);
  InprocessTraining training(options, route, route.frames);
  Map map(study.layout);
  Json curve = {{"episodes", Json::array()}, {"spl", Json::array()}};
  while (!training.trainer().done()) {
    throw_if_stopped();
    training.update();
    double spl = 0;
    for (const Episode& episode : training.finished()) spl += map.spl(episode);
    curve["episodes"].push_back(training.trainer().progress().episodes);
    curve["spl"].push_back(number(spl / static_cast<double>(training.finished().size())));  // none: NaN, which is null
  }
  const TrainedAgent agent = training.trainer().agent();
  Json outcome = tried(study, world, [&] { return std::make_unique<NetworkPolicy>(agent, NetworkPolicy::Options()); });
  outcome["curve"] = curve;
  outcome["episodes"] = training.trainer().progress().episodes;
  outcome["steps"] = training.trainer().progress().steps;
  return outcome;
}

Json control(const MapStudy& study, World& world) {
  const Traversal route = cut_out(world.traversal(study.representation, world.train()), study.layout, study.junctions);
  const auto& entry = ControlRegistry::instance().find("control", study.policy);
  const ControlTask task{0, route.frames,
                         Eigen::Map<const Matrix<float>>(route.features.data(), route.dimension, route.frames),
                         route.turns};
  return tried(study, world,
               [&] { return entry.create(Parameters("control " + study.policy, entry.parameters, {}), task); });
}

}  // namespace

Unit unit_of(const MapStudy& study, World& world) {
  Unit unit;
  unit.name = fmt::format("{}{} on a map of {} places, {} junctions{}", study.learns ? "training " : "", study.policy,
                          study.layout.frames, study.junctions ? "with" : "without",
                          study.learns ? fmt::format(", seed {}", study.seed) : "");
  unit.spec = {{"kind", "map"},
               {"policy", study.policy},
               {"junctions", study.junctions},
               {"representation", study.representation},
               {"train", world.train()},
               {"recordings", world.hashes(study.traversals)},
               {"frames", {study.layout.first, study.layout.first + study.layout.frames}},
               {"crossings", junctions_of(study.layout.turns)},
               {"tasks", study.tasks}};
  if (study.learns) {
    unit.spec["parameters"] = Trainer::recommended_parameters(study.policy, "ppo");
    unit.spec["seed"] = study.seed;
    unit.spec["steps"] = study.steps;
  }
  unit.seconds = study.seconds;
  unit.compute = [study, &world] { return study.learns ? train(study, world) : control(study, world); };
  return unit;
}

}  // namespace citylearn::paper
