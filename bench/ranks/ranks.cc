// SPDX-License-Identifier: Apache-2.0
// What do several learners gain that share the work, and what does sharing cost? (README.md)
#include <cstdio>
#include <string>
#include <thread>
#include <vector>

#include "bench/bench.h"
#include "bench/parameters.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/ranks/gloo_group.h"
#include "policy_service/ranks/shared_updates.h"
#include "tools/lab/training.h"

namespace citylearn {
namespace {

struct Options {
  TrainerOptions trainer;
  std::string dataset = "plain", data, train = "summer";
  std::vector<std::string> interfaces = {"lo"}, peers;
  std::uint32_t domain = 0;
  std::vector<std::string> set;  ///< name=value, of network, learner or trainer
  std::vector<int> ranks = {1, 2, 4};
  std::vector<std::uint64_t> seeds = {1};
  int frames = 128, share = 0, rank = 0;
  double spl = 0.95;
  bool each_step = false;
};

RankOptions rank_options(const Options& options, int rank, int ranks) {
  RankOptions one;
  one.rank = rank;
  one.ranks = ranks;
  one.node.id = "bench";
  one.node.middleware.domain = options.domain;
  one.node.middleware.interfaces = options.interfaces;
  one.node.middleware.peers = options.peers;
  one.identity = "{}";
  return one;
}

/// Trains with so many ranks, each in a thread, until the mean SPL of the last 100 episodes of all is reached.
TrainingProgress train(const Options& options, const Traversal& route, int ranks, std::uint64_t seed) {
  TrainingProgress result;
  const auto learn = [&](int rank) {
    TrainerOptions trainer_options = options.trainer;
    trainer_options.seed = seed;
    trainer_options.rank = rank;
    trainer_options.threads = 1;
    InprocessTraining training(trainer_options, route, options.frames);
    Trainer& trainer = training.trainer();
    GlooGroup group(rank_options(options, rank, ranks), nullptr);
    SharedUpdates sharing(group, options.each_step);
    trainer.share_updates(sharing);
    while (!trainer.done() && !(trainer.progress().episodes >= 100 && trainer.progress().spl >= options.spl))
      training.update();
    group.leave();
    if (rank == 0) result = trainer.progress();
  };
  std::vector<std::thread> threads;
  for (int rank = 1; rank < ranks; ++rank) threads.emplace_back(learn, rank);
  learn(0);
  for (std::thread& thread : threads) thread.join();
  return result;
}

void measure_learning(const Options& options) {
  const auto dataset = DatasetRegistry::instance().find("dataset", options.dataset);
  const Traversal route =
      dataset.create(Parameters("dataset", dataset.parameters, {}), options.data)->load(options.train);
  for (const std::uint64_t seed : options.seeds) {
    double first = 0;
    for (const int ranks : options.ranks) {
      TrainingProgress progress;
      const double seconds = bench::seconds([&] { progress = train(options, route, ranks, seed); });
      const double steps = static_cast<double>(progress.steps) / ranks;
      if (first == 0) first = steps;
      std::printf(
          "%s, seed %llu, %d ranks: SPL %.3f after %.0f steps a rank (%llu updates), %.2f of the first; %.0f s\n",
          options.trainer.agent.c_str(), static_cast<unsigned long long>(seed), ranks, progress.spl, steps,
          static_cast<unsigned long long>(progress.updates), steps / first, seconds);
      std::fflush(stdout);
    }
  }
}

/// Shares an agent's parameters and moments again and again as one of several ranks in processes of their own, so that
/// these may be in network namespaces with slow links.
void measure_sharing(const Options& options) {
  GlooGroup group(rank_options(options, options.rank, options.ranks.front()), nullptr);
  std::vector<float> values(static_cast<std::size_t>(options.share));
  std::vector<double> seconds;
  for (int round = 0; round < 30; ++round) {
    group.meet({static_cast<std::uint64_t>(round), "", ""});
    std::fill(values.begin(), values.end(), 1.0f);
    const double taken = bench::seconds([&] {
      group.sum(values);
      if (!group.agree(true)) throw Error("a rank was lost", "bench_ranks");
    });
    if (values.back() != static_cast<float>(options.ranks.front())) throw Error("the sum is wrong", "bench_ranks");
    if (round > 0) seconds.push_back(taken);
  }
  group.leave();
  std::printf("rank %d of %d: %d numbers (%.1f MB) shared in %.1f ms (median of 29)\n", options.rank,
              options.ranks.front(), options.share, 4e-6 * options.share, 1e3 * bench::median(seconds));
}

}  // namespace
}  // namespace citylearn

int main(int argc, char** argv) {
  citylearn::Options options;
  options.trainer.agent = "features";
  CLI::App app("Trains one agent with several ranks in threads", "bench_ranks");
  app.add_option("--data", options.data, "folder of the dataset");
  app.add_option("--dataset", options.dataset, "")->capture_default_str();
  app.add_option("--train", options.train, "traversal")->capture_default_str();
  app.add_option("--agent", options.trainer.agent, "network")->capture_default_str();
  app.add_option("--learner", options.trainer.learner, "learner")->capture_default_str();
  app.add_option("--set", options.set, "name=value of the learner's or trainer's parameters");
  app.add_option("--ranks", options.ranks, "numbers of ranks")->capture_default_str();
  app.add_option("--seeds", options.seeds, "")->capture_default_str();
  app.add_option("--frames", options.frames, "N")->capture_default_str();
  app.add_option("--spl", options.spl, "mean of the last 100 episodes at which training ends")->capture_default_str();
  app.add_flag("--each-step", options.each_step, "share gradients at each step instead of parameters once an update");
  app.add_option("--domain", options.domain, "DDS domain in which they meet")->capture_default_str();
  app.add_option("--interface", options.interfaces, "A,B,...")->delimiter(',')->capture_default_str();
  app.add_option("--peers", options.peers, "hosts of all ranks")->delimiter(',');
  app.add_option("--share", options.share, "be one --rank of --ranks that shares so many numbers, train nothing");
  app.add_option("--rank", options.rank, "with --share");
  return citylearn::bench::run(app, argc, argv, [&] {
    citylearn::bench::give_parameters(options.set, options.trainer);
    if (options.share > 0)
      citylearn::measure_sharing(options);
    else
      citylearn::measure_learning(options);
  });
}
