// SPDX-License-Identifier: Apache-2.0
// Is our own PPO at least as fast as the same in libtorch? (README.md)
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/bench.h"
#include "bench/made_up.h"
#include "core/plugin/plugins.h"
#include "core/wire/messages.h"
#include "policy_service/learning/learner.h"
#include "policy_service/learning/trainer.h"

#ifndef CITYLEARN_TORCH_PPO
#define CITYLEARN_TORCH_PPO ""
#endif

namespace citylearn {
namespace {

using bench::median;

struct Contender {
  std::string name;
  int threads;
  std::unique_ptr<Learner> learner = nullptr;
  std::vector<double> seconds = {};  ///< of each update
};

/// Interleaved updates on one rollout, with the network's recommended parameters.
void compare(int cells, int rounds) {
  const std::string agent = "features";
  const auto recommended = Trainer::recommended_parameters(agent, "ppo");
  const auto trainer = recommended.at("trainer");
  const int steps = static_cast<int>(trainer.at("segment")), agents = static_cast<int>(trainer.at("agents"));
  NetworkTask task;
  task.features = 64;
  const auto& entry = NetworkRegistry<float>::instance().find("network", agent);
  const Parameters parameters(agent, entry.parameters, {{"cells", cells}});
  const auto network = entry.create(parameters, task);
  Rollout rollout =
      bench::made_up_rollout(task, network->state_size(), steps, agents, static_cast<int>(trainer.at("sequence")));
  Rollout* const rollouts[] = {&rollout};

  // Torch's threads wait for one another at every product, and so may be slower than one alone: it gets its choice.
  WorkerPool workers(2);
  Contender contenders[] = {{"ppo", 2}, {"torch_ppo", 1}, {"torch_ppo", 2}};
  for (Contender& one : contenders) {
    const auto& learner_entry = LearnerRegistry::instance().find("learner", one.name);
    std::map<std::string, double> values = recommended.at("learner");
    if (one.name == "torch_ppo") values["gpu"] = 0, values["threads"] = one.threads;
    one.learner = learner_entry.create(Parameters(one.name, learner_entry.parameters, values),
                                       LearnerTask{*network, agent, parameters, task, workers, 1, 0});
  }
  std::vector<double> ratios;
  for (int round = 0; round < rounds; ++round) {
    for (Contender& one : contenders) {
      one.learner->update(rollouts);  // to warm up, and until the other's threads have gone to sleep
      one.seconds.push_back(bench::seconds([&] { one.learner->update(rollouts); }));
    }
    ratios.push_back(std::min(contenders[1].seconds.back(), contenders[2].seconds.back()) /
                     contenders[0].seconds.back());
  }
  for (const Contender& one : contenders)
    std::printf("cells %3d  %-9s  %d thread%s  %8.1f ms an update of %d steps, %6.0f steps/s\n", cells,
                one.name.c_str(), one.threads, one.threads == 1 ? " " : "s", 1e3 * median(one.seconds), steps * agents,
                steps * agents / median(one.seconds));
  std::printf("cells %3d  ppo learns %.2f times as fast as the faster torch_ppo\n", cells, median(ratios));
  std::fflush(stdout);
}

void compare_learners(const std::string& plugin, int rounds) {
  if (plugin.empty()) {
    std::printf("skipped: built without libtorch (docs/how-to/load-a-plugin.md)\n");
    return;
  }
  const Clock::time_point start = Clock::now();
  load_plugin(plugin);
  std::printf("loading torch_ppo took %.2f s\n", seconds_since(start));
  for (const int cells : {256, 64}) compare(cells, rounds);
}

}  // namespace
}  // namespace citylearn

int main(int argc, char** argv) {
  std::string plugin = CITYLEARN_TORCH_PPO;
  int rounds = 3;
  CLI::App app("Compares the updates of ppo and torch_ppo on the same rollouts", "bench_torch");
  app.add_option("--torch-ppo", plugin, "torch_ppo.so")->capture_default_str();
  app.add_option("--rounds", rounds, "measured updates of each")->check(CLI::PositiveNumber)->capture_default_str();
  return citylearn::bench::run(app, argc, argv, [&] { citylearn::compare_learners(plugin, rounds); });
}
