// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <deque>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "policy_service/learning/trainer.h"
#include "policy_service/learning/trainer_parameters.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {

/// A stretch of the curriculum.
struct Lesson {
  int frames, max_steps;
};

/// Returns the mean of the lengths of episodes; NaN where there are none.
double mean_steps(const std::deque<int>& steps);

/// The progress of a trainer, as a checkpoint has it.
struct SavedProgress {
  TrainingProgress progress;
  std::uint64_t lesson_episodes = 0, generation = 0;
  std::vector<std::array<double, 2>> recent;
  std::size_t recent_next = 0;
  std::deque<int> recent_steps;
};

/// The state of a Trainer. trainer.cc trains; trainer_checkpoint.cc saves and loads.
struct Trainer::Impl {
  TrainerOptions options;
  NetworkTask task;
  TrainerParameters parameters;
  std::unique_ptr<WorkerPool> workers;
  std::unique_ptr<const AgentNetwork<float>> network;
  std::shared_ptr<const AgentNetwork<float>> shared_network;  ///< the one that agent() returns
  std::unique_ptr<Learner> learner;
  int segment = 0, sequence = 0;
  std::uint64_t total_steps = 0;
  std::vector<std::string> frozen;  ///< names of tensors, in their order
  std::vector<Lesson> lessons;

  std::unique_ptr<Collector> collector;
  std::uint64_t collector_seed = 0;
  UpdateSharing* sharing = nullptr;
  double elapsed = 0;
  std::uint64_t generation = 0;
  TrainingProgress progress;
  std::uint64_t lesson_episodes = 0;          ///< finished in the present lesson
  std::vector<std::array<double, 2>> recent;  ///< reward and SPL of the last episodes, a ring
  std::size_t recent_next = 0;
  std::deque<int> recent_steps;  ///< of the last episodes, the oldest first

  const Lesson& lesson() const { return lessons[static_cast<std::size_t>(progress.lesson)]; }
  void begin_generation() {
    ++generation;
    collector->reset_all(generation, lesson().frames);
  }

  void count_episodes(std::span<const FinishedEpisode> finished);
  /// Makes the learner's update the one of all trainers, and counts it.
  void share(LocalUpdate mine, const std::function<void()>& learn);
  void start_from(const TrainedAgent& agent);
  void freeze();
  /// Returns what must be the same in a trainer that continues.
  nlohmann::json identity() const;
  nlohmann::json progress_json() const;
  /// Returns everything that continuing in the present generation needs.
  Checkpoint checkpoint() const;
  /// Returns what progress_json() wrote. Throws Error or a nlohmann::json::exception when it is something else.
  SavedProgress read_progress(const nlohmann::json& saved) const;
  void continue_from(SavedProgress saved);
};

}  // namespace citylearn
