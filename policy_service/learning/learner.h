// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "policy_service/network/agent_network.h"
#include "policy_service/rollout/rollout.h"
#include "policy_service/rollout/worker_pool.h"

namespace citylearn {

/// The task that a learner is built for.
struct LearnerTask {
  const AgentNetwork<float>& network;  ///< must outlive the learner
  std::string agent;                   ///< name of the network
  Parameters parameters;               ///< parameters of the network
  const NetworkTask& task;             ///< task of the network; must outlive the learner
  WorkerPool& workers;                 ///< threads for work that it divides; must outlive the learner
  std::uint64_t seed = 1;              ///< of the initial parameters and of the learner's own random numbers
  std::uint64_t total_steps = 0;       ///< environment steps of the whole run at most, for schedules
};

/// Figures of one update: means over its samples and epochs. The LEARNED ones of core/task/training_figures.inc, and
/// the auxiliary losses.
struct UpdateFigures {
#define LEARNED(name, ...) double name = 0;
#include "core/task/training_figures.inc"
  double localisation_loss = 0;  ///< squared error of the estimated place; 0 where it is not asked for
  double orientation_loss = 0;   ///< squared error of the estimated way to the goal, likewise
};

/// A learner's whole state, for checkpoints. Learners that share the work (UpdateSharing) average "parameters" and all
/// tensors "adam.*", and have the same counters "steps" (environment steps learned from), "updates" and "adam_steps".
/// Everything else stays with its learner.
struct LearnerState {
  std::map<std::string, std::uint64_t> counters;
  std::map<std::string, Vector<float>> tensors;  ///< "parameters" among them
};

/// Returns whether learners that share the work average this tensor.
inline bool is_shared(const std::string& tensor) { return tensor == "parameters" || tensor.starts_with("adam."); }

/// Sums values over several learners.
class GradientSharing {
 public:
  virtual ~GradientSharing() = default;
  /// Replaces the values by their sums, bit for bit the same in all learners. Throws what ends the update.
  virtual void sum(std::span<float> values) = 0;
};

/// Improves the parameters of a network from what its agents saw and did. It sees tensors, never topics or images. Used
/// by one thread; it may divide its work, but the same rollouts give the same bits on any number of threads.
class Learner {
 public:
  virtual ~Learner() = default;
  /// Tells schedules, before an update, which fraction of the run's time has passed (0..1, never falling). The fraction
  /// of its steps may be larger. A learner without schedules ignores it.
  virtual void set_progress(double /*fraction*/) {}
  /// Makes one update from rollouts and fills in their advantages.
  virtual UpdateFigures update(std::span<Rollout* const> rollouts) = 0;
  virtual const Vector<float>& parameters() const = 0;
  virtual void save(LearnerState& state) const = 0;
  /// Throws Error when `state` is of another network or learner; the learner is then as before.
  virtual void load(const LearnerState& state) = 0;
  /// Keeps these parts of the parameters as they are, bit for bit; the others learn as if these did not exist. Called
  /// before the first update. Returns false, with nothing changed, when this learner cannot do that.
  virtual bool freeze(std::span<const Tensor> /*tensors*/) { return false; }
  /// Makes each step with the mean of several learners' gradients from the next update on; null ends that. An update
  /// that an exception ended may be made again after load(). Returns false, with nothing changed, when this learner
  /// cannot do that.
  virtual bool share_gradients(GradientSharing* /*sharing*/) { return false; }
};

/// Learners by name; their parameters are all the hyper-parameters.
using LearnerRegistry = Registry<Learner, const LearnerTask&>;

}  // namespace citylearn
