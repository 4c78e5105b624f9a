// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/study.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "core/task/spl.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"

namespace citylearn::paper {
namespace {

using Episode = Environment::Episode;
using Episodes = std::vector<Episode>;

Json as_json(const Score& score) {
  return {{"tasks", score.tasks},           {"completed", score.completed}, {"spl", score.spl},
          {"excess", number(score.excess)}, {"steps", score.mean_steps},    {"reward", score.reward}};
}

/// A study that is computed.
class Run {
 public:
  Run(const Study& study, World& world) : study_(study), world_(world), train_(world.train()) {}

  Json train();
  Json control();

 private:
  const Traversal& traversal(const std::string& name) { return world_.traversal(study_.representation, name); }

  /// Episodes of a fresh policy.
  Episodes play(const std::unique_ptr<Policy>& policy, const std::string& name, int tasks, bool shuffle = false) {
    Trial trial;
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
  if (study_.steps > 0) options.trainer_parameters["steps"] = static_cast<double>(study_.steps);
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
  InprocessTraining training(trainer_options(), traversal(train_), study_.frames,
                             {environments(), study_.imperfections});
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
      Json row = as_json(score(play(policy_of(trainer.agent()), name, study_.tasks, shuffled)));
      row.update({{"shuffled", shuffled}, {"traversal", name}});
      trials.push_back(std::move(row));
    }
  return {{"deployments", deployments},
          {"trials", trials},
          {"seconds", seconds},
          {"spl95", spl95},
          {"curve", curve},
          {"episodes", trainer.progress().episodes},
          {"steps", trainer.progress().steps}};
}

Json Run::control() {
  const auto& entry = ControlRegistry::instance().find("control", study_.policy);
  return tried([&](const std::string& name) {
    const Traversal& known = traversal(study_.policy == "oracle_filter" ? name : train_);
    const NetworkTask route = network_task(known, 0, study_.frames);
    return entry.create(Parameters("control " + study_.policy, entry.parameters, study_.parameters),
                        {0, study_.frames, route.reference});
  });
}

/// Returns what a progress line calls the study.
std::string name_of(const Study& study) {
  const Imperfections& world = study.imperfections;
  const bool trains = !study.control;
  std::string name = trains ? "training " + study.policy : study.policy;
  name += fmt::format(" on {}, {} places", study.representation, study.frames);
  if (trains) name += fmt::format(", seed {}", study.seed);
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
  Json spec = {{"kind", study.control ? "control" : "training"},
               {"representation", study.representation},
               {"train", world.train()},
               {"recordings", world.hashes(study.traversals)},
               {"frames", {0, study.frames}},
               {"tasks", study.tasks}};
  if (study.control)
    spec["control"] = study.policy;
  else
    spec.update({{"parameters", Trainer::recommended_parameters(study.policy, study.learner)},
                 {"seed", study.seed},
                 {"steps", study.steps},
                 {"agent", study.policy},
                 {"learner", study.learner},
                 {"tasks", {study.tasks, study.tasks_between}},
                 {"deploy_every", study.deploy_every}});
  if (study.imperfections != Imperfections()) spec["imperfections"] = as_json(study.imperfections);
  if (!study.parameters.empty()) spec[study.control ? "parameters" : "network"] = study.parameters;
  double seconds = study.control ? 1 : study.seconds;
  // A filter looks at all places at each step; longer routes take more of both.
  if (study.control && study.policy.ends_with("_filter"))
    seconds += 4e-8 * study.tasks * study.frames * study.frames * static_cast<double>(study.traversals.size());
  return {name_of(study), spec, seconds, [study, &world] {
            Run run(study, world);
            return study.control ? run.control() : run.train();
          }};
}

}  // namespace citylearn::paper
