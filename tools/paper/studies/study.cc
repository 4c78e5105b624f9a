// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/study.h"

#include <openssl/evp.h>
#include <spdlog/fmt/fmt.h>
#include <spdlog/fmt/ranges.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

#include "core/task/spl.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"
#include "tools/paper/studies/walk.h"

namespace citylearn::paper {
namespace {

using Episode = Environment::Episode;
using Episodes = std::vector<Episode>;

Json as_json(const Score& score) {
  return {{"tasks", score.tasks},           {"completed", score.completed}, {"spl", score.spl},
          {"excess", number(score.excess)}, {"steps", score.mean_steps},    {"reward", score.reward}};
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

/// A study that is computed.
class Run {
 public:
  Run(const Study& study, World& world) : study_(study), world_(world), train_(world.train()) {}

  Json train();
  Json unchanged();
  Json control();

 private:
  const Traversal& traversal(const std::string& name) { return world_.traversal(study_.representation, name); }

  /// The traversal learned from and other ones.
  Experiences experiences() {
    Experiences all(traversal(train_));
    for (const std::string& name : study_.experiences) all.push_back(&traversal(name));
    return all;
  }

  /// Episodes of a fresh policy.
  Episodes play(const std::unique_ptr<Policy>& policy, const std::string& name, int tasks, bool shuffle = false) {
    Trial trial;
    trial.first_frame = study_.first;
    trial.frames = trial.max_steps = study_.frames;
    trial.tasks = tasks;
    trial.shuffle = shuffle;
    trial.imperfections = study_.imperfections;
    trial.interrupt = throw_if_stopped;  // trials on long routes take minutes
    return try_out(*policy, traversal(name), trial);
  }

  /// Tries a fresh policy on each traversal: [{"traversal", SCORE}].
  template <class Make>
  Json tried(const Make& make) {
    Json rows = Json::array();
    for (const std::string& name : study_.traversals) {
      Json row = as_json(score(play(make(name), name, study_.tasks)));
      row["traversal"] = name;
      rows.push_back(std::move(row));
    }
    return rows;
  }

  /// Adds the means over the episodes that ended in one update.
  void add_point(Json& curve, const TrainingProgress& progress, double seconds, const Episodes& finished) {
    double reward = 0, spl = 0, length = 0;
    for (const Episode& episode : finished) {
      reward += static_cast<double>(episode.reward);
      length += episode.steps;
      spl += spl_of(episode.completed, episode.shortest, episode.steps);
    }
    const auto n = static_cast<double>(finished.size());  // none: NaN, which is null
    curve["episodes"].push_back(progress.episodes);
    curve["spl"].push_back(number(spl / n));
    curve["steps"].push_back(progress.steps);
    curve["seconds"].push_back(seconds);
    curve["reward"].push_back(number(reward / n));
    curve["length"].push_back(number(length / n));
  }

  /// Returns the saved agent with its parameters and the features of the route's places.
  TrainedAgent initial_agent() {
    const SavedAgent& saved = *study_.initial;
    TrainedAgent agent;
    agent.name = saved.study["agent"].get<std::string>();
    const std::string where = "the trained " + agent.name;
    const Json& outcome = saved.work->outcome(saved.study);
    if (outcome.is_null()) throw Error("its training failed", where);
    agent.task = network_task(traversal(train_), study_.first, study_.frames);
    agent.first_frame = study_.first;
    const auto& entry = NetworkRegistry<float>::instance().find("network", agent.name);
    agent.network = entry.create(Parameters("network " + agent.name, entry.parameters, {}), agent.task);
    agent.parameters = unpacked(outcome.at("parameters").get<std::string>(), agent.network->parameter_count(), where);
    return agent;
  }

  static std::unique_ptr<Policy> policy_of(const TrainedAgent& agent) {
    return std::make_unique<NetworkPolicy>(agent, NetworkPolicy::Options());
  }

  TrainerOptions trainer_options();
  int environments();

  const Study& study_;
  World& world_;
  const std::string& train_;
};

TrainerOptions Run::trainer_options() {
  TrainerOptions options;
  options.agent = study_.policy;
  options.learner = study_.learner;
  options.seed = study_.seed;
  options.first_frame = study_.first;
  if (study_.steps > 0) options.trainer_parameters["steps"] = static_cast<double>(study_.steps);
  if (study_.initial) options.initial = initial_agent();
  options.frozen = study_.frozen;
  options.network_parameters = study_.parameters;
  return options;
}

/// Returns so many environments that the features of each one's agents fit into an observation.
int Run::environments() {
  const auto parameters = Trainer::recommended_parameters(study_.policy, study_.learner);
  const int agents = static_cast<int>(parameters.at("trainer").at("agents"));
  const int room = std::max(1, static_cast<int>(msg::MAX_FEATURES) / std::max(1, traversal(train_).dimension));
  int environments = 1;
  while (agents / environments > room || agents % environments != 0) ++environments;
  return environments;
}

Json Run::train() {
  const Experiences known = experiences();
  InprocessTraining training(trainer_options(), known, study_.frames, {environments(), study_.imperfections});
  Trainer& trainer = training.trainer();
  Json curve;
  for (const char* name : {"episodes", "spl", "steps", "seconds", "reward", "length"}) curve[name] = Json::array();
  Json deployments = Json::array(), spl95 = nullptr;
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
    if (study_.deploy_every > 0 && progress.episodes >= deploy_at) {
      const Clock::time_point pause = Clock::now();
      while (deploy_at <= progress.episodes) deploy_at += static_cast<std::uint64_t>(study_.deploy_every);
      for (const std::string& name : study_.traversals) {
        Json row = as_json(score(play(policy_of(trainer.agent()), name, study_.tasks_between)));
        row.update({{"episodes", progress.episodes}, {"traversal", name}});
        deployments.push_back(std::move(row));
      }
      judging += seconds_since(pause);
    }
  }
  const double seconds = seconds_since(start) - judging;
  Json trials = Json::array();
  for (const std::string& name : study_.traversals)
    for (const bool shuffled : {false, true}) {
      const Episodes episodes = play(policy_of(trainer.agent()), name, study_.tasks, shuffled);
      Json row = as_json(score(episodes));
      row.update({{"shuffled", shuffled}, {"traversal", name}});
      if (!shuffled) row["walk"] = walk_of(episodes, traversal(name).frames);
      trials.push_back(std::move(row));
    }
  Json outcome = {{"deployments", deployments},
                  {"trials", trials},
                  {"seconds", seconds},
                  {"spl95", spl95},
                  {"curve", curve},
                  {"episodes", trainer.progress().episodes},
                  {"steps", trainer.progress().steps}};
  if (study_.save_parameters) outcome["parameters"] = packed(trainer.network_parameters());
  return outcome;
}

Json Run::unchanged() {
  const TrainedAgent agent = initial_agent();
  return tried([&](const std::string&) { return policy_of(agent); });
}

Json Run::control() {
  const auto& entry = ControlRegistry::instance().find("control", study_.policy);
  return tried([&](const std::string& name) {
    const Experiences known = study_.policy == "oracle_filter" ? Experiences(traversal(name)) : experiences();
    const NetworkTask route = network_task(known, study_.first, study_.frames);
    return entry.create(Parameters("control " + study_.policy, entry.parameters, study_.parameters),
                        {study_.first, study_.frames, route.reference});
  });
}

/// Returns what a progress line calls the study.
std::string name_of(const Study& study) {
  const Imperfections& world = study.imperfections;
  if (study.kind == Study::Kind::kUnchanged)
    return fmt::format("{} as it is on {}, places {} to {}, seed {}", study.policy, study.representation, study.first,
                       study.first + study.frames - 1, study.seed);
  const bool trains = study.kind == Study::Kind::kTraining;
  std::string name = trains ? "training " + study.policy : study.policy;
  name += fmt::format(" on {}, {} places", study.representation, study.frames);
  if (trains) {
    name += fmt::format(", seed {}", study.seed);
    if (study.first > 0) name += fmt::format(", from place {} on", study.first);
    if (!study.experiences.empty()) name += fmt::format(", on {} too", fmt::join(study.experiences, ", "));
    if (study.initial) name += ", carried over";
    if (!study.frozen.empty()) name += fmt::format(", {} frozen", fmt::join(study.frozen, ", "));
  }
  if (world != Imperfections())
    name += fmt::format(", slip {:g}, dropped frames {:g}, kidnappings {}", world.slip, world.dropped_frames,
                        world.kidnappings);
  return trains || study.parameters.empty() ? name : name + ", told";
}

}  // namespace

Json as_json(const Imperfections& world) {
  return {{"slip", world.slip}, {"dropped_frames", world.dropped_frames}, {"kidnappings", world.kidnappings}};
}

Unit unit_of(const Study& study, World& world) {
  const bool trains = study.kind == Study::Kind::kTraining, unchanged = study.kind == Study::Kind::kUnchanged;
  std::vector<std::string> recordings = study.traversals;
  if (unchanged) recordings.push_back(world.train());  // where its knowledge of the places comes from
  Json spec = {{"kind", trains      ? "training"
                        : unchanged ? "carried"
                                    : "control"},
               {"representation", study.representation},
               {"train", world.train()},
               {"recordings", world.hashes(recordings)},
               {"frames", {study.first, study.first + study.frames}},
               {"tasks", study.tasks}};
  if (trains)
    spec.update({{"parameters", Trainer::recommended_parameters(study.policy, study.learner)},
                 {"seed", study.seed},
                 {"steps", study.steps}});
  if (trains) {
    spec.update({{"agent", study.policy},
                 {"learner", study.learner},
                 {"tasks", {study.tasks, study.tasks_between}},
                 {"deploy_every", study.deploy_every}});
    if (study.save_parameters) spec["keep"] = true;
    if (study.initial) spec["initial"] = study.initial->study;
    if (!study.frozen.empty()) spec["frozen"] = study.frozen;
  } else if (unchanged) {
    spec["agent"] = study.initial->study;
  } else {
    spec["control"] = study.policy;
  }
  if (!study.experiences.empty()) spec["experiences"] = world.hashes(study.experiences);
  if (study.imperfections != Imperfections()) spec["imperfections"] = as_json(study.imperfections);
  if (!study.parameters.empty()) spec[trains ? "network" : "parameters"] = study.parameters;
  double seconds = trains ? study.seconds : 1;
  if (!trains &&
      study.policy.ends_with("_filter"))  // looks at all places at each step; longer routes take more of both
    seconds += 4e-8 * study.tasks * study.frames * study.frames * static_cast<double>(study.traversals.size());
  return {name_of(study), spec, seconds, [study, &world] {
            Run run(study, world);
            return study.kind == Study::Kind::kTraining    ? run.train()
                   : study.kind == Study::Kind::kUnchanged ? run.unchanged()
                                                           : run.control();
          }};
}

SavedAgent saved_agent(const Study& study, World& world, const Work& work) {
  return {unit_of(study, world).spec, &work};
}

}  // namespace citylearn::paper
