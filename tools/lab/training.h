// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <vector>

#include "env_service/environment.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/results/score.h"
#include "policy_service/rollout/policy.h"

namespace citylearn {

/// The environments of a training.
struct Hosting {
  int environments = 1;              ///< that share the recommended agents
  Imperfections imperfections = {};  ///< of their world, those that befall agents
};

/// A trainer and its environments in one process, without a wire. It learns what the services learn in lockstep.
class InprocessTraining {
 public:
  /// Frames options.first_frame .. + frames - 1 of `route`, which must outlive this and have features (an agent that
  /// needs none takes it as it is). Throws Error as Trainer and network_task() do.
  InprocessTraining(const TrainerOptions& options, const Traversal& route, int frames, const Hosting& hosting = {});

  /// Plays one segment of every environment and learns from it.
  UpdateFigures update();

  Trainer& trainer() { return trainer_; }
  /// Returns the episodes that ended in the last update's segment, by environment.
  const std::vector<Environment::Episode>& finished() const { return finished_; }
  double acting() const { return acting_; }      ///< seconds so far
  double learning() const { return learning_; }  ///< seconds so far

 private:
  void step(Environment& environment);

  Trainer trainer_;
  std::vector<Environment> environments_;
  std::vector<Environment::Episode> finished_;
  std::uint64_t generation_ = ~std::uint64_t{0};
  double acting_ = 0, learning_ = 0;
  msg::Observation observation_;
  msg::TaskSettings settings_;
  std::vector<std::uint8_t> choice_;
};

/// Returns the task of a route's frames first .. first + frames - 1, as a network is made for it. Throws Error when the
/// route lacks some of these.
NetworkTask network_task(const Traversal& route, int first, int frames);

/// The numbered tasks that a policy is tried on.
struct Trial {
  int first_frame = 0, frames = 128, max_steps = 128, tasks = 2000;
  std::uint64_t seed = 4711;                ///< the same seed: the same tasks, on whichever traversal
  int max_detour = 0;                       ///< as TaskSettings has it
  bool shuffle = false;                     ///< frames shown in a random order
  Imperfections imperfections = {};         ///< of the world, those that befall agents
  int goals = 1;                            ///< of a task
  std::function<void()> interrupt = [] {};  ///< called before each step; what it throws ends the trial
};

/// Returns the episodes by task, of a policy that has decided nothing yet. Throws Error, and what the policy throws.
std::vector<Environment::Episode> try_out(Policy& policy, const Traversal& traversal, const Trial& trial);
Score score(const std::vector<Environment::Episode>& episodes);

}  // namespace citylearn
