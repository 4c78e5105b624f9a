// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn {

struct CollectorOptions {
  std::uint64_t seed = 1;
  int first_frame = 0;              ///< of the route, index on the traversal
  int segment = 64, sequence = 64;  ///< steps; see Trainer
  /// Lengths of what disguises a frame's features, in lengths of these: new at each look; of each place, for an
  /// episode; of a whole episode.
  double noise_frame = 0, noise_place = 0, noise_episode = 0;
};

/// An episode that ended within a segment.
struct FinishedEpisode {
  int tick = 0, agent = 0;  ///< the action `tick` (from 1) of the segment ended it
  double reward = 0, spl = 0;
};

/// Acts on any number of environments, each with agents of its own, and notes what a learner wants to know: a Rollout
/// of `segment` steps for each environment. No wire and no clock: the same observations and parameters give the same
/// bits, in whatever order the environments' observations come. Used by one thread.
class Collector {
 public:
  /// `task` and `network` must outlive it.
  Collector(const CollectorOptions& options, const NetworkTask& task, const AgentNetwork<float>& network);
  ~Collector();

  /// All environments begin anew, on the route's first `frames` places. `cut` names the random streams from here on.
  void begin_cut(std::uint64_t cut, int frames);
  /// An environment takes part from its first observation on. `environment` names its random streams. Called again, it
  /// begins anew: what it had of the segment is dropped.
  void add(int environment, int agents);
  void remove(int environment);
  /// Of starts and goals, for TaskSettings.
  std::uint64_t environment_seed(int environment) const;

  /// Takes in the next observation; the first one must be of step 0. True: `choice` has the actions. False: the segment
  /// is full. Throws Error when the observation does not fit.
  bool act(int environment, const msg::Observation& observation, const Vector<float>& parameters,
           std::vector<std::uint8_t>& choice);
  bool full(int environment) const;
  /// All environments are full; false when there is none.
  bool ready() const;
  /// Of a full environment: what its agents saw and did.
  Rollout& rollout(int environment);
  /// The episodes that ended in its segment, in the order of their ends.
  const std::vector<FinishedEpisode>& finished(int environment) const;
  /// Forgets the segment; the next one begins with resume().
  void begin_segment(int environment);
  /// The actions for the observation that found the last segment full.
  void resume(int environment, const Vector<float>& parameters, std::vector<std::uint8_t>& choice);
  /// In rising order.
  std::vector<int> environments() const;

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace citylearn
