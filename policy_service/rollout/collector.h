// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/rollout/rollout.h"
#include "policy_service/rollout/worker_pool.h"

namespace citylearn {

struct CollectorOptions {
  std::uint64_t seed = 1;
  int first_frame = 0;              ///< of the route, index on the traversal
  int segment = 64, sequence = 64;  ///< steps; see Trainer
  /// Lengths of the noise on a frame's features, relative to theirs: drawn at each step; for each place of an episode;
  /// for an episode.
  double noise_frame = 0, noise_place = 0, noise_episode = 0;
};

/// An episode that ended within a segment.
struct FinishedEpisode {
  int tick = 0, agent = 0;  ///< the action `tick` (from 1) of the segment ended it
  double reward = 0, spl = 0;
  int steps = 0;  ///< its length
};

/// Acts on any number of environments, each with agents of its own, and records what a learner needs: a Rollout of
/// `segment` steps for each environment. It uses neither wire nor clock: the same observations and parameters give the
/// same bits, in whatever order the environments' observations arrive and on however many threads. Used by one thread.
class Collector {
 public:
  /// `network` and `workers` must outlive it. Agents are divided into pieces, which `workers` compute at the same time.
  Collector(const CollectorOptions& options, const NetworkTask& task, const AgentNetwork<float>& network,
            WorkerPool& workers);
  ~Collector();

  /// Begins all environments anew, on the route's first `frames` places. `generation` then names the random streams.
  void reset_all(std::uint64_t generation, int frames);
  /// Adds an environment, whose number names its random streams, on a traversal that is this experience of the route
  /// (NetworkTask::reference). Called again, the environment begins anew and its part of the segment is dropped.
  void add(int environment, int agents, int experience = 0);
  void remove(int environment);
  /// Returns the seed of starts and goals, for TaskSettings.
  std::uint64_t environment_seed(int environment) const;

  /// Takes in the next observation; the first one must be of step 0. Returns true with the actions in `choice`, or
  /// false when the segment is full. Throws Error when the observation does not fit.
  bool act(int environment, const msg::Observation& observation, const Vector<float>& parameters,
           std::vector<std::uint8_t>& choice);
  bool full(int environment) const;
  /// Returns whether all environments are full; false when there is none.
  bool ready() const;
  /// Returns what the agents of a full environment saw and did.
  Rollout& rollout(int environment);
  /// Returns the episodes that ended in its segment, in the order of their ends.
  const std::vector<FinishedEpisode>& finished(int environment) const;
  /// Drops the segment; the next one begins with resume().
  void begin_segment(int environment);
  /// Chooses the actions for the observation that found the last segment full.
  void resume(int environment, const Vector<float>& parameters, std::vector<std::uint8_t>& choice);
  /// Fills what the agents believed when their last actions were chosen, as Policy::believe() does.
  void believe(int environment, msg::Belief& belief) const;
  /// Returns the environments in rising order.
  std::vector<int> environments() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
