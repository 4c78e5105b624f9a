// SPDX-License-Identifier: Apache-2.0
// What does learning gain from more threads, and what do more shards cost? (README.md)
#include <algorithm>
#include <cstdio>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bench/bench.h"
#include "bench/figures.h"
#include "bench/made_up.h"
#include "core/util/processors.h"
#include "policy_service/learning/trainer.h"

namespace citylearn {
namespace {

struct Options {
  std::vector<std::string> agents = {"features", "baseline", "place_filter"};
  std::string learner = "ppo";
  std::vector<int> shards = {2, 4, 8}, threads = {1, 2};
  int minibatch = 16, rounds = 7;
};

struct Contender {
  int shards, threads;
  std::unique_ptr<WorkerPool> workers;
  std::unique_ptr<Learner> learner;
  std::vector<double> seconds = {}, ratios = {};  ///< of each update; speed relative to the first contender's
};

/// Interleaved updates on one rollout, with the network's recommended parameters but for the minibatch.
void compare(const std::string& agent, const Options& options) {
  constexpr int kFeatures = 64, kPlaces = 128;
  const auto recommended = Trainer::recommended_parameters(agent, options.learner);
  const auto trainer = recommended.at("trainer");
  const int segment = static_cast<int>(trainer.at("segment")), sequence = static_cast<int>(trainer.at("sequence"));
  const int agents = std::max(static_cast<int>(trainer.at("agents")), options.minibatch * sequence / segment);
  NetworkTask task;
  task.features = kFeatures;
  task.frames = kPlaces;
  task.reference = Matrix<float>::Random(kFeatures, kPlaces).colwise().normalized();
  const auto& network_entry = NetworkRegistry<float>::instance().find("network", agent);
  const Parameters network_parameters(agent, network_entry.parameters, recommended.at("network"));
  const auto network = network_entry.create(network_parameters, task);
  const auto& learner_entry = LearnerRegistry::instance().find("learner", options.learner);
  Rollout rollout = bench::made_up_rollout(task, network->state_size(), segment, agents, sequence);
  rollout.max_steps = kPlaces;
  Rollout* const rollouts[] = {&rollout};

  std::vector<Contender> contenders;
  for (const int shards : options.shards)
    for (const int threads : options.threads) {
      std::map<std::string, double> values = recommended.at("learner");
      values["minibatch"] = options.minibatch;
      values["shards"] = shards;
      auto workers = std::make_unique<WorkerPool>(threads);
      auto learner = learner_entry.create(Parameters(options.learner, learner_entry.parameters, values),
                                          LearnerTask{*network, agent, network_parameters, task, *workers, 1, 0});
      contenders.push_back({shards, threads, std::move(workers), std::move(learner)});
    }
  for (int round = 0; round <= options.rounds; ++round)
    for (Contender& one : contenders) {
      const double seconds = bench::seconds([&] { one.learner->update(rollouts); });
      if (round == 0) continue;  // to warm up
      one.seconds.push_back(seconds);
      one.ratios.push_back(contenders.front().seconds.back() / seconds);
    }
  for (const Contender& one : contenders) {
    const double rate = segment * agents / bench::median(one.seconds);
    std::printf("%-12s  %2d shards  %2d thread%s  %9.0f steps/s learned from, ratio %.2f\n", agent.c_str(), one.shards,
                one.threads, one.threads == 1 ? " " : "s", rate, bench::median(one.ratios));
    bench::record_figure(
        {.name = agent + ", shards " + std::to_string(one.shards) + ", threads " + std::to_string(one.threads),
         .value = rate,
         .unit = "steps/s"});
  }
  std::fflush(stdout);
}

void measure(const Options& options) {
  std::printf("%s, minibatches of %d sequences, %d processors; ratios to %d shards on %d thread%s\n",
              options.learner.c_str(), options.minibatch, available_processors(), options.shards.front(),
              options.threads.front(), options.threads.front() == 1 ? "" : "s");
  for (const std::string& agent : options.agents) compare(agent, options);
}

}  // namespace
}  // namespace citylearn

int main(int argc, char** argv) {
  citylearn::Options options;
  CLI::App app("Compares the updates of a learner on more threads and in more shards", "bench_threads");
  app.add_option("--agent", options.agents, "networks")->capture_default_str();
  app.add_option("--learner", options.learner, "learner")->capture_default_str();
  app.add_option("--shards", options.shards, "of a minibatch")->check(CLI::Range(1, 256))->capture_default_str();
  app.add_option("--threads", options.threads, "that learn")->check(CLI::Range(1, 1024))->capture_default_str();
  app.add_option("--minibatch", options.minibatch, "sequences")->check(CLI::Range(1, 65536))->capture_default_str();
  app.add_option("--rounds", options.rounds, "measured updates of each")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  return citylearn::bench::run(app, argc, argv, [&] { citylearn::measure(options); });
}
