// SPDX-License-Identifier: Apache-2.0
// onnx_sample FOLDER: agents trained on the drawn city as FOLDER/NETWORK/agent.onnx, features.bin (32-bit floats, a
// frame of another season after the other) and episodes.json: what the services' agent does there, step by step.
#include <filesystem>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "core/util/random.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/interchange/export.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/rollout/task_waves.h"
#include "tests/support/env/env.h"
#include "tests/support/files.h"
#include "tools/lab/training.h"

namespace {

using namespace citylearn;
using namespace citylearn::testing;

constexpr int kFrames = 64;
constexpr std::uint64_t kSeed = 3;  // of drawn actions

Traversal recording(const std::string& name) {
  const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
  const Parameters parameters("synthetic", entry.parameters, {{"frames", kFrames}, {"images", 0}});
  return entry.create(parameters, "")->load(name);
}

/// Returns the agent's steps in the first three tasks of an evaluation: one after the other, each with what was seen
/// before. `longest` becomes the length of the longest episode.
nlohmann::json steps(const TrainedAgent& agent, const Traversal& season, std::uint64_t task_seed, int& longest) {
  nlohmann::json steps = nlohmann::json::array();
  NetworkPolicy policy(agent, {.seed = kSeed, .greedy = false});
  Environment environment(season, 1);
  msg::TaskSettings wave = settings(msg::EVALUATE, kFrames, kFrames, task_seed);
  msg::Observation seen;
  std::vector<std::uint8_t> choice;
  std::uint32_t task = 0;
  Random random(0);
  int length = 0;
  for (TaskWaves waves(4); waves.wave().first < 3 && !waves.done(); waves.next(policy.seen())) {
    wave.first_task() = waves.wave().first;
    wave.tasks() = waves.wave().first == 2 ? 1 : waves.wave().count;
    environment.reset(wave);
    policy.begin(waves.wave().first, waves.known());
    task = waves.wave().first;
    while (!environment.done()) {
      environment.observe(seen);
      policy.act(seen, choice);
      const bool first = (seen.flags()[0] & msg::FLAG_FIRST) != 0;
      if (first) random = Random{kSeed, task++};
      longest = std::max(longest, length = first ? 1 : length + 1);
      steps.push_back({{"frame", seen.frame()[0]},
                       {"goal", seen.goal()[0]},
                       {"previous", seen.previous_action()[0]},
                       {"allowed", seen.allowed()[0]},
                       {"first", first},
                       {"random", random.uniform()},
                       {"action", choice[0]}});
      environment.step(choice);
    }
  }
  return steps;
}

void write(const std::string& target, const std::string& network, int updates) {
  std::filesystem::create_directories(target);
  const Traversal reference = recording("summer"), season = recording("fall");
  TrainerOptions options;
  options.agent = network;
  InprocessTraining training(options, reference, kFrames);
  for (int update = 0; update < updates; ++update) training.update();
  const Folder folder;
  write_checkpoint(folder / "one.clk", training.trainer().checkpoint());
  export_agent({folder / "one.clk", "", target + "agent.onnx"});
  std::ofstream(target + "features.bin", std::ios::binary)
      .write(reinterpret_cast<const char*>(season.features.data()),
             static_cast<std::streamsize>(season.features.size() * sizeof(float)));
  const TrainedAgent agent = trained_agent(read_checkpoint(folder / "one.clk"));
  for (std::uint64_t task_seed = 1; task_seed < 50; ++task_seed) {  // an episode may begin beside its goal
    int longest = 0;
    const nlohmann::json all = steps(agent, season, task_seed, longest);
    if (longest < 30) continue;
    std::ofstream(target + "episodes.json") << nlohmann::json{{"frames", kFrames}, {"steps", all}};
    return;
  }
  throw Error("no episode is long enough");
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error("needs FOLDER");
  const std::string target = std::string(argv[1]) + "/";
  write(target + "place_filter/", "place_filter", 16);
  write(target + "features/", "features", 8);
} catch (const std::exception& error) {
  std::cerr << "onnx_sample: " << error.what() << "\n";
  return 1;
}
