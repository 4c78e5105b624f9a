// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/training.h"

#include <fmt/core.h>

#include "bench/cases/cases.h"
#include "core/util/error.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/rollout/network_policy.h"

namespace citylearn::bench {
namespace {

struct Options {
  TrainerOptions trainer;
  std::string dataset = "synthetic", data, train = "summer";
  std::vector<std::string> evaluate = {"summer", "fall"};
  std::vector<std::string> set;  ///< name=value, of network, learner or trainer
  int frames = 128, tasks = 2000;
  double time_limit = 0;
};

/// Assigns each name=value to the part that has such a parameter: network, learner or trainer. Throws Error.
void give_parameters(const std::vector<std::string>& set, TrainerOptions& options) {
  const auto known = Trainer::recommended_parameters(options.agent, options.learner);
  for (const std::string& one : set) {
    const std::size_t equals = one.find('=');
    if (equals == std::string::npos) throw Error("is not name=value", "--set " + one);
    const std::string name = one.substr(0, equals);
    const double value = std::stod(one.substr(equals + 1));
    if (known.at("network").contains(name))
      options.network_parameters[name] = value;
    else if (known.at("learner").contains(name))
      options.learner_parameters[name] = value;
    else if (known.at("trainer").contains(name))
      options.trainer_parameters[name] = value;
    else
      throw Error("no such parameter", "--set " + one);
  }
}

/// Prints what the agent is worth on tasks of a traversal.
void evaluate(const TrainedAgent& agent, const Traversal& traversal, const Options& options) {
  NetworkPolicy policy(agent, {});
  Trial trial;
  trial.frames = trial.max_steps = options.frames;
  trial.tasks = options.tasks;
  const Score f = score(try_out(policy, traversal, trial));
  fmt::print("  {:<8} completed {:.4f}  SPL {:.4f}  steps {:5.1f}  reward {:.4f}\n", traversal.name, f.completed, f.spl,
             f.mean_steps, f.reward);
}

/// Prints how far training has come: episodes, steps and seconds.
void print(const std::string& what, const TrainingProgress& progress, double seconds) {
  fmt::print("{} after {} episodes, {} steps, {:.1f} s\n", what, progress.episodes, progress.steps, seconds);
  std::fflush(stdout);
}

void train(const Options& options) {
  const auto& entry = DatasetRegistry::instance().find("dataset", options.dataset);
  std::map<std::string, double> given;
  if (options.dataset == "synthetic") given["images"] = 0;
  const auto source = entry.create(Parameters("dataset", entry.parameters, given), options.data);
  const Traversal route = source->load(options.train);
  InprocessTraining training(options.trainer, route, options.frames);
  Trainer& trainer = training.trainer();
  std::vector<double> thresholds = {0.95, 0.9};  // of SPL, the next one last
  const Clock::time_point start = Clock::now();
  while (!trainer.done() && (options.time_limit <= 0 || seconds_since(start) < options.time_limit)) {
    training.update();
    const TrainingProgress& progress = trainer.progress();
    for (; !thresholds.empty() && progress.episodes >= 100 && progress.spl >= thresholds.back(); thresholds.pop_back())
      print(fmt::format("SPL of the last 100 training episodes reached {:.2f}", thresholds.back()), progress,
            seconds_since(start));
    if (progress.updates % 10 == 0)
      print(fmt::format("reward {:.3f}  SPL {:.3f}", progress.reward, progress.spl), progress, seconds_since(start));
  }
  const double wall = seconds_since(start), steps = static_cast<double>(trainer.progress().steps);
  fmt::print("trained {}, seed {}: {:.0f} steps, {:.1f} s, {:.0f} steps/s; acting {:.0f} %, learning {:.0f} % of it\n",
             options.trainer.agent, options.trainer.seed, steps, wall, steps / wall, 100 * training.acting() / wall,
             100 * training.learning() / wall);
  for (const std::string& name : options.evaluate) evaluate(trainer.agent(), source->load(name), options);
}

}  // namespace

Measure training(CLI::App& command) {
  const auto options = std::make_shared<Options>();
  command.add_option("--agent", options->trainer.agent, "network");
  command.add_option("--learner", options->trainer.learner, "learner");
  command.add_option("--seed", options->trainer.seed, "of all randomness");
  command.add_option("--threads", options->trainer.threads, "that act and learn; 0: as many as processors")
      ->check(CLI::Range(0, 1024));
  command.add_option("--set", options->set, "name=value: a parameter of network, learner or trainer");
  command.add_option("--dataset", options->dataset, "dataset with features");
  command.add_option("--data", options->data, "folder of the dataset");
  command.add_option("--train", options->train, "traversal");
  command.add_option("--evaluate", options->evaluate, "traversals");
  command.add_option("--frames", options->frames, "N");
  command.add_option("--tasks", options->tasks, "of each evaluation");
  command.add_option("--time-limit", options->time_limit, "seconds of training; 0: none");
  return [=] {
    give_parameters(options->set, options->trainer);
    train(*options);
  };
}

}  // namespace citylearn::bench
