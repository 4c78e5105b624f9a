// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "bench/cases/cases.h"
#include "bench/made_up.h"
#include "core/plugin/plugins.h"
#include "core/util/processors.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/network/product.h"

#ifndef CITYLEARN_TORCH_PPO
#define CITYLEARN_TORCH_PPO ""
#endif

namespace citylearn::bench {
namespace {

using Values = std::map<std::string, double>;

/// Learners with the recommended parameters of a network, timed by turns on one rollout of it.
class Learners {
 public:
  /// `network` has what differs from the recommendation. The rollout has at least a minibatch of sequences.
  Learners(const std::string& agent, const std::string& learner, const Values& network = {}, int minibatch = 0)
      : agent_(agent), recommended_(Trainer::recommended_parameters(agent, learner)) {
    const auto trainer = [&](const char* name) { return static_cast<int>(recommended_["trainer"].at(name)); };
    const int segment = trainer("segment"), sequence = trainer("sequence");
    const int agents = std::max(trainer("agents"), minibatch * sequence / segment);
    steps = segment * agents;
    task_.features = 64;
    task_.frames = 128;
    task_.reference = Matrix<float>::Random(task_.features, task_.frames).colwise().normalized();
    for (const auto& [name, value] : network) recommended_["network"][name] = value;
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
  Learners learners(agent, options.learner, {}, options.minibatch);
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

void compare_with_torch(int cells, int rounds) {
  Learners learners("features", "ppo", {{"cells", cells}});
  learners.add("ppo", 2, {}, "ppo, 2 threads");
  // Torch's threads wait for one another at every product, and so may be slower than one alone: it gets its choice.
  for (const int threads : {1, 2})
    learners.add("torch_ppo", 2, {{"gpu", 0}, {"threads", threads}},
                 "torch_ppo, " + std::to_string(threads) + " threads");
  take_turns(learners.contenders, rounds, /*warm_each=*/true);  // also until the other's threads have gone to sleep
  std::vector<double> ratios;
  for (std::size_t round = 0; round < static_cast<std::size_t>(rounds); ++round)
    ratios.push_back(std::min(learners.contenders[1].ratios[round], learners.contenders[2].ratios[round]));
  for (const Contender& one : learners.contenders)
    std::printf("cells %3d  %-20s  %8.1f ms an update of %d steps, %6.0f steps/s\n", cells, one.name.c_str(),
                1e3 * median(one.seconds), learners.steps, learners.steps / median(one.seconds));
  std::printf("cells %3d  ppo learns %.2f times as fast as the faster torch_ppo\n", cells, median(ratios));
  std::fflush(stdout);
}

/// The matrix products of one forward and backward pass of the paper's network over L steps of B sequences, with
/// nothing around them.
class BareProducts {
 public:
  BareProducts(int sensors, int hidden, int cells, int extra, int steps, int sequences)
      : steps_(steps), sequences_(sequences) {
    const int columns = steps * sequences, gates = 4 * cells;
    const auto random = [](int rows, int cols) { return Matrix<float>(Matrix<float>::Random(rows, cols)); };
    sensor_ = random(hidden, sensors), input_ = random(gates, hidden + extra), recurrent_ = random(gates, cells);
    back_ = random(cells, gates), head_ = random(kActions + 3, cells);
    sensed_ = random(sensors, columns), embedded_ = random(hidden + extra, columns), gates_ = random(gates, columns);
    h_ = random(cells, columns), out_ = random(kActions + 3, columns), hidden_ = random(hidden, columns);
  }
  void run() {
    set_product(hidden_, sensor_, sensed_);
    set_product(gates_, input_, embedded_);
    for (int t = 0; t < steps_; ++t) set_product(columns(gates_, t), recurrent_, columns(h_, t));
    set_product(out_, head_, h_);
    set_product(head_gradient_, out_, h_.transpose());
    set_product(h_gradient_, head_.transpose(), out_);
    for (int t = 1; t < steps_; ++t) set_product(carried_, back_, columns(gates_, t));
    set_product(recurrent_gradient_, gates_, h_.transpose());
    set_product(input_gradient_, gates_, embedded_.transpose());
    set_product(hidden_gradient_, input_.leftCols(hidden_.rows()).transpose(), gates_);
    set_product(sensor_gradient_, hidden_gradient_, sensed_.transpose());
  }

 private:
  Eigen::Block<Matrix<float>> columns(Matrix<float>& all, int t) {
    return all.block(0, t * sequences_, all.rows(), sequences_);
  }
  int steps_, sequences_;
  Matrix<float> sensor_, input_, recurrent_, back_, head_, sensed_, embedded_, gates_, h_, out_, hidden_;
  Matrix<float> head_gradient_, h_gradient_, carried_, recurrent_gradient_, input_gradient_, hidden_gradient_,
      sensor_gradient_;
};

/// Compares a learner's update with its matrix products alone, both on two threads.
void compare_with_products(const std::string& learner, int cells, int rounds) {
  constexpr int kThreads = 2, kHidden = 512;
  Learners learners("features", learner, {{"cells", cells}});
  learners.add(learner, kThreads, {}, "an update");
  auto recommended = Trainer::recommended_parameters("features", learner);
  const auto number = [&](const char* part, const char* name) {
    return static_cast<int>(recommended.at(part).at(name));
  };
  const int segment = number("trainer", "segment"), minibatch = number("learner", "minibatch");
  const int passes = number("learner", "epochs") * number("trainer", "agents") / minibatch;
  WorkerPool workers(kThreads);
  std::vector<BareProducts> bare(kThreads, {64 + 1, kHidden, cells, 2 * kActions, segment, minibatch / kThreads});
  learners.contenders.push_back({"its products alone", [&] {
                                   for (int i = 0; i < passes; ++i)
                                     workers.run(kThreads,
                                                 [&](int which) { bare[static_cast<std::size_t>(which)].run(); });
                                 }});
  take_turns(learners.contenders, rounds);
  for (const Contender& one : learners.contenders)
    std::printf("cells %3d  %-20s  %8.1f ms\n", cells, one.name.c_str(), 1e3 * median(one.seconds));
  std::printf("cells %3d  ratio %.2f; %.0f steps/s learned from\n", cells, 1 / median(learners.contenders[1].ratios),
              learners.steps / median(learners.contenders[0].seconds));
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

Measure updates(CLI::App& command) {
  const auto learner = std::make_shared<std::string>("ppo");
  const auto rounds = std::make_shared<int>(9);
  command.add_option("--learner", *learner, "learner");
  command.add_option("--rounds", *rounds, "measured updates of each")->check(CLI::PositiveNumber);
  return [=] {
    for (const int cells : {256, 64}) compare_with_products(*learner, cells, *rounds);
  };
}

Measure torch(CLI::App& command) {
  const auto plugin = std::make_shared<std::string>(CITYLEARN_TORCH_PPO);
  const auto rounds = std::make_shared<int>(3);
  command.add_option("--torch-ppo", *plugin, "torch_ppo.so");
  command.add_option("--rounds", *rounds, "measured updates of each")->check(CLI::PositiveNumber);
  return [=] {
    if (plugin->empty()) {
      std::printf("skipped: built without libtorch (docs/how-to/load-a-plugin.md)\n");
      return;
    }
    std::printf("loading torch_ppo took %.2f s\n", seconds([&] { load_plugin(*plugin); }));
    for (const int cells : {256, 64}) compare_with_torch(cells, *rounds);
  };
}

}  // namespace citylearn::bench
