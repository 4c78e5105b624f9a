// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <string>

#include "policy_service/network/agent_network.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn {

/// What a learner is built for.
struct LearnerTask {
  const AgentNetwork<float>& network;  ///< must outlive the learner
  std::string agent;                   ///< the network's name,
  Parameters parameters;               ///< its own,
  const NetworkTask& task;             ///< and what it was built for; outlives the learner
  std::uint64_t seed = 1;              ///< of the parameters' start and of the learner's own draws
  std::uint64_t total_steps = 0;       ///< environment steps of the whole run at most, for schedules
};

/// Figures of one update: means over its samples and epochs.
struct UpdateFigures {
  double policy_loss = 0;
  double value_loss = 0;
  double entropy = 0;            ///< nats
  double divergence = 0;         ///< approximate KL(old || new), nats
  double clipped = 0;            ///< share of samples outside the clip range, 0..1
  double localisation_loss = 0;  ///< squared error of telling one's place; 0 where it is not asked for
  double orientation_loss = 0;   ///< squared error of telling the way to the goal, likewise
  double gradient_norm = 0;      ///< before clipping
  double learning_rate = 0;
};

/// A learner's whole state, for checkpoints.
struct LearnerState {
  std::map<std::string, std::uint64_t> counters;
  std::map<std::string, Vector<float>> tensors;  ///< "parameters" among them
};

/// Improves the parameters of a network from what its agents saw and did. Sees tensors, never topics or images. Used by
/// one thread; may use threads of its own, but the same rollouts give the same bits.
class Learner {
 public:
  virtual ~Learner() = default;
  /// Before an update of a run that may end before its total_steps, by the clock: so much of it (0..1, never falling)
  /// is over, if not more by the steps. Schedules go by it; a learner without any need not listen.
  virtual void come_to(double /*share*/) {}
  /// One update from the rollouts that the current parameters collected. Fills their advantages.
  virtual UpdateFigures update(std::span<Rollout* const> rollouts) = 0;
  virtual const Vector<float>& parameters() const = 0;
  virtual void save(LearnerState& state) const = 0;
  /// Throws Error when `state` is of another network or learner; the learner is then as before.
  virtual void load(const LearnerState& state) = 0;
  /// From now on these parts of the parameters stay as they are, bit for bit, and the others learn as if there were
  /// none. Called before the first update. False: this learner cannot do that, and nothing has changed.
  virtual bool freeze(std::span<const Tensor> /*tensors*/) { return false; }
};

/// Learners by name; their parameters are all the hyper-parameters.
using LearnerRegistry = Registry<Learner, const LearnerTask&>;

}  // namespace citylearn
