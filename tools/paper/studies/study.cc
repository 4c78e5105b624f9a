// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/study.h"

#include <openssl/evp.h>
#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <cstring>

#include "core/task/spl.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

Json as_json(const Score& score) {
  return {{"tasks", score.tasks},           {"completed", score.completed}, {"spl", score.spl},
          {"excess", number(score.excess)}, {"steps", score.mean_steps},    {"reward", score.reward}};
}

Json as_json(const Imperfections& imperfections) {
  return {{"slip", imperfections.slip},
          {"dropped_frames", imperfections.dropped_frames},
          {"kidnappings", imperfections.kidnappings}};
}

/// Adds the imperfections, if any, to the name and the spec of what is done in such a world.
void describe(const Imperfections& imperfections, Unit& unit) {
  const Json all = as_json(imperfections);
  if (all == as_json(Imperfections())) return;
  unit.name += fmt::format(", slip {:g}, dropped frames {:g}, kidnappings {}", imperfections.slip,
                           imperfections.dropped_frames, imperfections.kidnappings);
  unit.spec["imperfections"] = all;
}

Trial trial_of(int first, int frames, int tasks, bool shuffle, const Imperfections& imperfections = {}) {
  Trial trial;
  trial.first_frame = first;
  trial.frames = trial.max_steps = frames;
  trial.tasks = tasks;
  trial.shuffle = shuffle;
  trial.imperfections = imperfections;
  trial.interrupt = throw_if_stopped;  // trials on long routes take minutes
  return trial;
}

std::unique_ptr<Policy> policy_of(const TrainedAgent& agent) {
  return std::make_unique<NetworkPolicy>(agent, NetworkPolicy::Options());
}

/// Returns {"traversal", SCORE} of a fresh policy; with `walk` also the walk that is shown.
Json tried(const std::unique_ptr<Policy>& policy, const Traversal& traversal, const Trial& trial, bool walk = false) {
  const std::vector<Environment::Episode> episodes = try_out(*policy, traversal, trial);
  Json row = as_json(score(episodes));
  row["traversal"] = traversal.name;
  if (walk) row["walk"] = walk_of(episodes, traversal.frames);
  return row;
}

/// Returns the traversal learned from and these others.
Experiences experiences_of(const std::vector<std::string>& others, const std::string& representation, World& world) {
  Experiences all(world.traversal(representation, world.train()));
  for (const std::string& name : others) all.push_back(&world.traversal(representation, name));
  return all;
}

/// The part of the spec that units without a training share.
Json spec_of(const char* kind, const Study& study, const std::vector<std::string>& recordings, World& world) {
  return {{"kind", kind},
          {"representation", study.representation},
          {"train", world.train()},
          {"recordings", world.hashes(recordings)},
          {"frames", {study.first, study.first + study.frames}},
          {"tasks", study.tasks}};
}

/// Adds the means over the episodes that ended in one update.
void add_point(Json& curve, const TrainingProgress& progress, double seconds,
               const std::vector<Environment::Episode>& finished) {
  double reward = 0, spl = 0, length = 0;
  for (const Environment::Episode& episode : finished) {
    reward += static_cast<double>(episode.reward);
    length += episode.steps;
    spl += spl_of(episode.completed, episode.shortest, episode.steps);
  }
  const auto n = static_cast<double>(finished.size());  // none: NaN, which is null
  curve["episodes"].push_back(progress.episodes);
  curve["steps"].push_back(progress.steps);
  curve["seconds"].push_back(seconds);
  curve["reward"].push_back(number(reward / n));
  curve["spl"].push_back(number(spl / n));
  curve["length"].push_back(number(length / n));
}

/// Encodes numbers as text without loss: base64 of little-endian floats.
std::string packed(const Vector<float>& numbers) {
  const std::size_t bytes = static_cast<std::size_t>(numbers.size()) * sizeof(float);
  std::string text(4 * ((bytes + 2) / 3) + 1, '\0');
  const int length = EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                                     reinterpret_cast<const unsigned char*>(numbers.data()), static_cast<int>(bytes));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

Vector<float> unpacked(const std::string& text, std::ptrdiff_t count, const std::string& where) {
  std::vector<unsigned char> bytes(text.size());
  const int length =
      EVP_DecodeBlock(bytes.data(), reinterpret_cast<const unsigned char*>(text.data()), static_cast<int>(text.size()));
  const auto wanted = static_cast<std::size_t>(count) * sizeof(float);
  // The decoder returns whole groups of three bytes, padded with zeros.
  if (length < 0 || static_cast<std::size_t>(length) != (wanted + 2) / 3 * 3)
    throw Error("the saved parameters are not " + std::to_string(count) + " numbers", where,
                "remove the folder given by --work");
  Vector<float> numbers(count);
  std::memcpy(numbers.data(), bytes.data(), wanted);
  return numbers;
}

/// Returns the agent with its saved parameters and the features of the route's places.
TrainedAgent agent_on(const SavedAgent& saved, const Traversal& route, int first, int frames) {
  TrainedAgent agent;
  agent.name = saved.study["agent"].get<std::string>();
  const std::string where = "the trained " + agent.name;
  const Json& outcome = saved.work->outcome(saved.study);
  if (outcome.is_null()) throw Error("its training failed", where);
  agent.task = network_task(route, first, frames);
  agent.first_frame = first;
  const auto& entry = NetworkRegistry<float>::instance().find("network", agent.name);
  agent.network = entry.create(Parameters("network " + agent.name, entry.parameters, {}), agent.task);
  agent.parameters = unpacked(outcome.at("parameters").get<std::string>(), agent.network->parameter_count(), where);
  return agent;
}

Json train(const Study& study, World& world) {
  const Traversal& route = world.traversal(study.representation, world.train());
  TrainerOptions options;
  options.agent = study.agent;
  options.learner = study.learner;
  options.seed = study.seed;
  options.first_frame = study.first;
  if (study.steps > 0) options.trainer_parameters["steps"] = static_cast<double>(study.steps);
  if (study.initial) options.initial = agent_on(*study.initial, route, study.first, study.frames);
  options.frozen = study.frozen;
  options.network_parameters = study.network_parameters;
  // So many environments that the features of each one's agents fit into an observation.
  const auto parameters = Trainer::recommended_parameters(study.agent, study.learner);
  const int agents = static_cast<int>(parameters.at("trainer").at("agents"));
  const int room = std::max(1, static_cast<int>(msg::MAX_FEATURES) / std::max(1, route.dimension));
  int environments = 1;
  while (agents / environments > room || agents % environments != 0) ++environments;
  const Experiences experiences = experiences_of(study.experiences, study.representation, world);
  InprocessTraining training(options, experiences, study.frames, {environments, study.imperfections});
  Trainer& trainer = training.trainer();

  Json curve = {{"episodes", Json::array()}, {"steps", Json::array()}, {"seconds", Json::array()},
                {"reward", Json::array()},   {"spl", Json::array()},   {"length", Json::array()}};
  Json deployments = Json::array(), trials = Json::array(), spl95 = nullptr;
  double judging = 0;
  std::uint64_t deploy_at = 0;
  const Clock::time_point start = Clock::now();
  while (!trainer.done()) {
    throw_if_stopped();
    training.update();
    const TrainingProgress& progress = trainer.progress();
    add_point(curve, progress, seconds_since(start) - judging, training.finished());
    if (spl95.is_null() && progress.episodes_to_spl95)
      spl95 = {{"episodes", *progress.episodes_to_spl95},
               {"steps", *progress.steps_to_spl95},
               {"seconds", seconds_since(start) - judging}};
    if (study.deploy_every > 0 && progress.episodes >= deploy_at) {
      const Clock::time_point pause = Clock::now();
      while (deploy_at <= progress.episodes) deploy_at += static_cast<std::uint64_t>(study.deploy_every);
      for (const std::string& name : study.traversals) {
        Json row = tried(policy_of(trainer.agent()), world.traversal(study.representation, name),
                         trial_of(study.first, study.frames, study.tasks_between, false, study.imperfections));
        row["episodes"] = progress.episodes;
        deployments.push_back(std::move(row));
      }
      judging += seconds_since(pause);
    }
  }
  const double seconds = seconds_since(start) - judging;
  for (const std::string& name : study.traversals)
    for (const bool shuffled : {false, true}) {
      Json row =
          tried(policy_of(trainer.agent()), world.traversal(study.representation, name),
                trial_of(study.first, study.frames, study.tasks, shuffled, study.imperfections), /*walk=*/!shuffled);
      row["shuffled"] = shuffled;
      trials.push_back(std::move(row));
    }
  Json outcome = {{"curve", curve},
                  {"deployments", deployments},
                  {"trials", trials},
                  {"episodes", trainer.progress().episodes},
                  {"steps", trainer.progress().steps},
                  {"seconds", seconds},
                  {"spl95", spl95}};
  if (study.save_parameters) outcome["parameters"] = packed(trainer.network_parameters());
  return outcome;
}

}  // namespace

Unit unit_of(const Study& study, World& world) {
  Unit unit;
  unit.name =
      fmt::format("training {} on {}, {} places, seed {}", study.agent, study.representation, study.frames, study.seed);
  if (study.first > 0) unit.name += fmt::format(", from place {} on", study.first);
  if (!study.experiences.empty()) unit.name += fmt::format(", on {} too", fmt::join(study.experiences, ", "));
  unit.spec = {{"kind", "training"},
               {"agent", study.agent},
               {"learner", study.learner},
               {"parameters", Trainer::recommended_parameters(study.agent, study.learner)},
               {"representation", study.representation},
               {"train", world.train()},
               {"recordings", world.hashes(study.traversals)},
               {"frames", {study.first, study.first + study.frames}},
               {"seed", study.seed},
               {"steps", study.steps},
               {"tasks", {study.tasks, study.tasks_between}},
               {"deploy_every", study.deploy_every}};
  if (!study.experiences.empty()) unit.spec["experiences"] = world.hashes(study.experiences);
  if (study.save_parameters) unit.spec["keep"] = true;
  if (study.initial) {
    unit.name += ", carried over";
    unit.spec["initial"] = study.initial->study;
  }
  if (!study.frozen.empty()) {
    unit.name += fmt::format(", {} frozen", fmt::join(study.frozen, ", "));
    unit.spec["frozen"] = study.frozen;
  }
  describe(study.imperfections, unit);
  if (!study.network_parameters.empty()) unit.spec["network"] = study.network_parameters;
  unit.seconds = study.seconds;
  unit.compute = [study, &world] { return train(study, world); };
  return unit;
}

SavedAgent saved_agent(const Study& study, World& world, const Work& work) {
  return {unit_of(study, world).spec, &work};
}

Unit transfer_unit(const SavedAgent& saved, const Study& task, World& world) {
  Unit unit;
  unit.name = fmt::format("{} as it is on {}, places {} to {}, seed {}", saved.study["agent"].get<std::string>(),
                          task.representation, task.first, task.first + task.frames - 1,
                          saved.study["seed"].get<std::uint64_t>());
  std::vector<std::string> recordings = task.traversals;
  recordings.push_back(world.train());  // where its knowledge of the places comes from
  unit.spec = spec_of("carried", task, recordings, world);
  unit.spec["agent"] = saved.study;
  unit.seconds = 1;
  unit.compute = [saved, task, &world] {
    const TrainedAgent agent =
        agent_on(saved, world.traversal(task.representation, world.train()), task.first, task.frames);
    Json rows = Json::array();
    for (const std::string& name : task.traversals)
      rows.push_back(tried(policy_of(agent), world.traversal(task.representation, name),
                           trial_of(task.first, task.frames, task.tasks, false)));
    return rows;
  };
  return unit;
}

Unit control_unit(const Study& study, World& world) {
  Unit unit;
  unit.name = fmt::format("{} on {}, {} places", study.agent, study.representation, study.frames);
  unit.spec = spec_of("control", study, study.traversals, world);
  unit.spec["control"] = study.agent;
  describe(study.imperfections, unit);
  if (!study.network_parameters.empty()) {
    unit.name += ", told";
    unit.spec["parameters"] = study.network_parameters;
  }
  if (!study.experiences.empty()) unit.spec["experiences"] = world.hashes(study.experiences);
  unit.seconds = 1;
  if (study.agent.ends_with("_filter"))  // looks at all places at each step, and longer routes take more of both
    unit.seconds += 4e-8 * study.tasks * study.frames * study.frames * static_cast<double>(study.traversals.size());
  unit.compute = [study, &world] {
    Json rows = Json::array();
    const auto& entry = ControlRegistry::instance().find("control", study.agent);
    for (const std::string& name : study.traversals) {
      const Experiences known = study.agent == "oracle_filter"
                                    ? Experiences(world.traversal(study.representation, name))
                                    : experiences_of(study.experiences, study.representation, world);
      const NetworkTask route = network_task(known, study.first, study.frames);
      const ControlTask task{study.first, study.frames, route.reference};
      rows.push_back(
          tried(entry.create(Parameters("control " + study.agent, entry.parameters, study.network_parameters), task),
                world.traversal(study.representation, name),
                trial_of(study.first, study.frames, study.tasks, false, study.imperfections)));
    }
    return rows;
  };
  return unit;
}

}  // namespace citylearn::paper
