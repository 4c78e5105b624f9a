// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "bench/cases/cases.h"
#include "core/task/action.h"
#include "core/util/processors.h"
#include "core/util/random.h"
#include "policy_service/learning/trainer.h"

namespace citylearn::bench {
namespace {

using Values = std::map<std::string, double>;

/// Fills inputs with random features, places and goals; one observation in fifty begins an episode. What is in them
/// does not change how long a pass takes.
void make_up(NetworkInputs<float>& inputs, const NetworkTask& task, int steps, int agents, Random& random) {
  inputs.resize(task.features, steps, agents);
  inputs.frames = task.frames;
  Vector<float> features(task.features);
  const auto place = [&] { return static_cast<int>(random.below(static_cast<std::uint64_t>(task.frames))); };
  for (int column = 0; column < steps * agents; ++column) {
    const auto i = static_cast<std::size_t>(column);
    for (float& value : features) value = static_cast<float>(random.normal());
    inputs.see(column, -1, features.normalized());
    inputs.position[i] = place();
    inputs.goal[i] = place();
    inputs.first[i] = random.below(50) == 0;
    inputs.previous_action[i] = kStay;
    inputs.allowed[i] = 7;
  }
}

/// Returns a rollout of such observations with random actions and rewards.
Rollout made_up_rollout(const NetworkTask& task, int state_size, int steps, int agents, int sequence) {
  Random random{1};
  Rollout rollout;
  rollout.resize(task.features, state_size, steps, agents, sequence);
  rollout.states.setZero();
  make_up(rollout.inputs, task, steps, agents, random);
  make_up(rollout.next, task, rollout.next.steps, rollout.next.agents, random);
  for (std::size_t i = 0; i < rollout.action.size(); ++i) {
    rollout.action[i] = static_cast<std::uint8_t>(random.below(kActions));
    rollout.log_probability[i] = -1.1f;
    rollout.reward[i] = static_cast<float>(random.normal());
  }
  return rollout;
}

/// Learners with the recommended parameters of a network, timed by turns on one rollout of it.
class Learners {
 public:
  /// The rollout has at least a minibatch of sequences.
  Learners(const std::string& agent, const std::string& learner, int minibatch)
      : agent_(agent), recommended_(Trainer::recommended_parameters(agent, learner)) {
    const auto trainer = [&](const char* name) { return static_cast<int>(recommended_["trainer"].at(name)); };
    const int segment = trainer("segment"), sequence = trainer("sequence");
    const int agents = std::max(trainer("agents"), minibatch * sequence / segment);
    steps = segment * agents;
    task_.features = 64;
    task_.frames = 128;
    task_.reference = Matrix<float>::Random(task_.features, task_.frames).colwise().normalized();
    const auto& entry = NetworkRegistry<float>::instance().find("network", agent);
    parameters_.emplace(agent, entry.parameters, recommended_["network"]);
    network_ = entry.create(*parameters_, task_);
    rollout_ = made_up_rollout(task_, network_->state_size(), segment, agents, sequence);
    rollout_.max_steps = task_.frames;
  }

  /// `values` has what differs from the recommendation.
  void add(const std::string& learner, int threads, const Values& values, const std::string& label) {
    Values all = values;
    all.insert(recommended_["learner"].begin(), recommended_["learner"].end());
    const auto& entry = LearnerRegistry::instance().find("learner", learner);
    workers_.push_back(std::make_unique<WorkerPool>(threads));
    std::shared_ptr<Learner> made =
        entry.create(Parameters(learner, entry.parameters, all),
                     LearnerTask{*network_, agent_, *parameters_, task_, *workers_.back(), 1, 0});
    contenders.push_back({label, [this, made] {
                            Rollout* const rollouts[] = {&rollout_};
                            made->update(rollouts);
                          }});
  }

  int steps = 0;  ///< of an update
  std::vector<Contender> contenders;

 private:
  std::string agent_;
  std::map<std::string, Values> recommended_;
  NetworkTask task_;
  std::optional<Parameters> parameters_;
  std::unique_ptr<AgentNetwork<float>> network_;
  Rollout rollout_;
  std::vector<std::unique_ptr<WorkerPool>> workers_;
};

struct ThreadsCase {
  std::vector<std::string> agents = {"features", "baseline", "place_filter"};
  std::string learner = "ppo";
  std::vector<int> shards = {2, 4, 8}, threads = {1, 2};
  int minibatch = 16, rounds = 7;
};

void compare(const std::string& agent, const ThreadsCase& options) {
  Learners learners(agent, options.learner, options.minibatch);
  for (const int shards : options.shards)
    for (const int threads : options.threads)
      learners.add(options.learner, threads, {{"minibatch", options.minibatch}, {"shards", shards}},
                   "shards " + std::to_string(shards) + ", threads " + std::to_string(threads));
  take_turns(learners.contenders, options.rounds);
  for (const Contender& one : learners.contenders) {
    const double rate = learners.steps / median(one.seconds);
    std::printf("%-12s  %-22s  %9.0f steps/s learned from, ratio %.2f\n", agent.c_str(), one.name.c_str(), rate,
                1 / median(one.ratios));
    record_figure({.name = agent + ", " + one.name, .value = rate, .unit = "steps/s"});
  }
  std::fflush(stdout);
}

}  // namespace

Measure threads(CLI::App& command) {
  const auto options = std::make_shared<ThreadsCase>();
  command.add_option("--agent", options->agents, "networks");
  command.add_option("--learner", options->learner, "learner");
  command.add_option("--shards", options->shards, "of a minibatch")->check(CLI::Range(1, 256));
  command.add_option("--threads", options->threads, "that learn")->check(CLI::Range(1, 1024));
  command.add_option("--minibatch", options->minibatch, "sequences")->check(CLI::Range(1, 65536));
  command.add_option("--rounds", options->rounds, "measured updates of each")->check(CLI::Range(1, 1000));
  return [options] {
    std::printf("%s, minibatches of %d sequences, %d processors; ratios to the first line\n", options->learner.c_str(),
                options->minibatch, available_processors());
    for (const std::string& agent : options->agents) compare(agent, *options);
  };
}

}  // namespace citylearn::bench
