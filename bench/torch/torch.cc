// SPDX-License-Identifier: Apache-2.0
// Is our own PPO at least as fast as the same in libtorch? (README.md)
#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "bench/bench.h"
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

/// Random numbers: what is in a rollout does not change how long an update takes.
Rollout some_rollout(const NetworkTask& task, int state_size, int steps, int agents, int sequence) {
  Random random{1};
  Rollout rollout;
  rollout.resize(task.features, state_size, steps, agents, sequence);
  rollout.inputs.frames = task.frames;
  rollout.states.setZero();
  Vector<float> features(task.features);
  for (int column = 0; column < steps * agents; ++column) {
    const auto i = static_cast<std::size_t>(column);
    for (float& value : features) value = static_cast<float>(random.normal());
    rollout.inputs.see(column, -1, features.normalized());
    rollout.inputs.position[i] = static_cast<int>(random.below(static_cast<std::uint64_t>(task.frames)));
    rollout.inputs.goal[i] = static_cast<int>(random.below(static_cast<std::uint64_t>(task.frames)));
    rollout.inputs.first[i] = random.below(50) == 0;  // as often as episodes end
    rollout.inputs.previous_action[i] = kStay;
    rollout.inputs.allowed[i] = 7;
    rollout.action[i] = static_cast<std::uint8_t>(random.below(kActions));
    rollout.log_probability[i] = -1.1f;
    rollout.reward[i] = static_cast<float>(random.normal());
  }
  return rollout;
}

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
  Rollout rollout = some_rollout(task, network->state_size(), steps, agents, static_cast<int>(trainer.at("sequence")));
  Rollout* const rollouts[] = {&rollout};

  // Torch's threads wait for one another at every product, and so may be slower than one alone: it gets its choice.
  Contender contenders[] = {{"ppo", 2}, {"torch_ppo", 1}, {"torch_ppo", 2}};
  for (Contender& one : contenders) {
    const auto& learner_entry = LearnerRegistry::instance().find("learner", one.name);
    std::map<std::string, double> values = recommended.at("learner");
    if (one.name == "torch_ppo") values["gpu"] = 0, values["threads"] = one.threads;
    one.learner = learner_entry.create(Parameters(one.name, learner_entry.parameters, values),
                                       LearnerTask{*network, agent, parameters, task, 1, 0});
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

int compare_learners(int argc, char** argv) {
  std::string plugin = CITYLEARN_TORCH_PPO;
  int rounds = 3;
  CLI::App app("Compares the updates of ppo and torch_ppo on the same rollouts");
  app.add_option("--torch-ppo", plugin, "torch_ppo.so")->capture_default_str();
  app.add_option("--rounds", rounds, "measured updates of each")->check(CLI::PositiveNumber)->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  if (plugin.empty()) {
    std::printf("skipped: built without libtorch (docs/how-to/load-a-plugin.md)\n");
    return 0;
  }
  const Clock::time_point start = Clock::now();
  load_plugin(plugin);
  std::printf("loading torch_ppo took %.2f s\n", seconds_since(start));
  for (const int cells : {256, 64}) compare(cells, rounds);
  return 0;
}

}  // namespace
}  // namespace citylearn

int main(int argc, char** argv) {
  int status = 0;
  const int failed = citylearn::bench::run("bench_torch", [&] { status = citylearn::compare_learners(argc, argv); });
  return failed ? failed : status;
}
