// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <spdlog/fmt/fmt.h>

#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "core/files/files.h"
#include "core/util/random.h"
#include "encoder_service/encoding/reduction.h"
#include "encoder_service/pipeline/learned_files.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/rollout/task_waves.h"
#include "tests/support/env/env.h"
#include "tests/support/files.h"
#include "tools/export/picture_export.h"
#include "tools/lab/descriptors.h"
#include "tools/lab/training.h"

namespace citylearn::testing {

/// One step of an agent as the services take it.
struct ServiceStep {
  int frame, goal, previous;  ///< of the traversal; the action before, or kNoAction
  unsigned allowed;           ///< a bit an action
  bool first;                 ///< of an episode
  double random;              ///< the number that draws the action
  int action;                 ///< drawn
};

/// An agent that learned on the drawn city by what an encoder and a reduction make of its pictures, and the same route
/// in another season, all as encoder_service and policy_service compute it.
class PictureAgent {
 public:
  static constexpr int kFrames = 64, kDimension = 24;
  static constexpr std::uint64_t kSeed = 3;  ///< of drawn actions

  PictureAgent(const std::string& agent, const std::string& encoder, const std::map<std::string, double>& values,
               const EncoderFiles& files, Centring centring, int updates)
      : files_(files), reference_(recording("summer")), season_(recording("fall")) {
    const auto& entry = EncoderRegistry::instance().find("encoder", encoder);
    encoder_ = entry.create(Parameters(encoder, entry.parameters, values), files);
    const Eigen::MatrixXf descriptors = lab::encode(*encoder_, reference_, "", "").matrix;
    reduction_ = Reduction::learn(descriptors, {.centring = centring, .dimension = kDimension});
    const Traversal learned = lab::with_features(reference_, reduction_.apply(descriptors));
    season_seen_ = lab::with_features(season_, reduction_.apply(lab::encode(*encoder_, season_, "", "").matrix));
    TrainerOptions options;
    options.agent = agent;
    InprocessTraining training(options, learned, kFrames);
    for (int update = 0; update < updates; ++update) training.update();
    checkpoint_ = training.trainer().checkpoint();
  }

  /// Writes what its run would have written into `folder`, and exports that; returns the bytes of folder/agent.onnx.
  std::string exported(const Folder& folder) const {
    const Encoder::Spec spec = encoder_->spec();
    PictureExportOptions options;
    options.store = folder / "store";
    std::filesystem::create_directory(options.store);
    const Bytes reduction = reduction_.save(spec.name);
    const std::uint64_t hash = reference_.hash();
    write_file(reduction_path(options.store, spec.name, hash, reduction_.options()),
               {reinterpret_cast<const char*>(reduction.data()), reduction.size()});
    ReductionOptions asked = reduction_.options();
    asked.dimension = 64;  // the recipe has what was asked for, the route is too short for it
    Checkpoint checkpoint = checkpoint_;
    TrainingData data;
    data.traversals = {{"summer", hash, kDimension, FeatureRecipe{spec.name, recipe_of(asked), hash}.text()}};
    checkpoint.header["data"] = nlohmann::json::parse(data.text());
    options.agent = {folder / "one.clk", "", folder / "agent.onnx"};
    write_checkpoint(options.agent.checkpoint, checkpoint);
    options.files = files_;
    options.picture = {season_picture(0).cols, season_picture(0).rows};
    export_picture_agent(options);
    return read_file(options.agent.output);
  }

  /// Returns the agent's steps in the first three tasks of an evaluation on the other season: one after the other, each
  /// with what was seen before.
  std::vector<ServiceStep> steps(std::uint64_t task_seed) const {
    std::vector<ServiceStep> steps;
    const TrainedAgent agent = trained_agent(checkpoint_);
    NetworkPolicy policy(agent, {.seed = kSeed, .greedy = false});
    Environment environment(season_seen_, 1);
    msg::TaskSettings wave = settings(msg::EVALUATE, kFrames, kFrames, task_seed);
    msg::Observation seen;
    std::vector<std::uint8_t> choice;
    std::uint32_t task = 0;
    Random random(0);
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
        steps.push_back({static_cast<int>(seen.frame()[0]), static_cast<int>(seen.goal()[0]), seen.previous_action()[0],
                         seen.allowed()[0], first, random.uniform(), choice[0]});
        environment.step(choice);
      }
    }
    return steps;
  }

  /// The same with at least one episode of `least` steps or more. Throws Error when there is none.
  std::vector<ServiceStep> long_steps(int least) const {
    for (std::uint64_t task_seed = 1; task_seed < 50; ++task_seed) {  // an episode may begin beside its goal
      std::vector<ServiceStep> all = steps(task_seed);
      int longest = 0, length = 0;
      for (const ServiceStep& step : all) longest = std::max(longest, length = step.first ? 1 : length + 1);
      if (longest >= least) return all;
    }
    throw Error("no episode is long enough");
  }

  /// A picture of the other season, BGR.
  cv::Mat season_picture(int frame) const { return lab::read_picture(season_, frame); }
  std::span<const float> features(int frame) const { return season_seen_.feature(frame); }

 private:
  static Traversal recording(const std::string& name) {
    const auto& entry = DatasetRegistry::instance().find("dataset", "synthetic");
    return entry.create(Parameters("synthetic", entry.parameters, {{"frames", kFrames}}), "")->load(name);
  }

  EncoderFiles files_;
  Traversal reference_, season_, season_seen_;
  std::unique_ptr<Encoder> encoder_;
  Reduction reduction_;
  Checkpoint checkpoint_;
};

/// Draws an action as sample_action() does, by the number that it draws with.
inline int drawn_action(const float* logits, double random) {
  double most = logits[0], sum = 0;
  for (int i = 1; i < kActions; ++i) most = std::max(most, static_cast<double>(logits[i]));
  double weights[kActions];
  for (int i = 0; i < kActions; ++i) sum += weights[i] = std::exp(static_cast<double>(logits[i]) - most);
  double left = random * sum;
  int action = 0;
  for (int i = 0; i < kActions; ++i) {
    if (weights[i] <= 0) continue;
    action = i;
    left -= weights[i];
    if (left < 0) break;
  }
  return action;
}

}  // namespace citylearn::testing
