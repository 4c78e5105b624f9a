// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "policy_service/learning/learner.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {

/// The part of one trainer in an update that several make together.
struct LocalUpdate {
  std::uint64_t updates = 0;              ///< made before this one
  std::uint64_t generation = 0;           ///< Trainer::generation()
  std::uint64_t steps = 0;                ///< environment steps that it learned from; 0 before the first update
  std::vector<FinishedEpisode> episodes;  ///< that ended meanwhile; their reward, SPL and steps are shared
  double elapsed = 0;                     ///< fraction of the run that has passed by its clock
  std::string progress;                   ///< of the trainer before this update, JSON
};

/// The result of such an update, the same for all trainers except for `progress`.
struct SharedUpdate {
  std::uint64_t steps = 0;                ///< of all
  std::vector<FinishedEpisode> episodes;  ///< of all, in the order of ranks
  double elapsed = 0;                     ///< the largest fraction
  std::uint64_t generation = 0;           ///< the largest one
  bool joined = false;                    ///< whether a trainer was behind, and now continues with the others
  std::optional<std::string> progress;    ///< what this trainer continues from, where it was behind itself
};

/// Makes the updates of several trainers one (docs/decisions/0021-ranks.md). Used by the trainer's thread.
class UpdateSharing {
 public:
  virtual ~UpdateSharing() = default;
  /// Makes the learner's own update, with `sharing` from where it was before each time, and fills in its state.
  using Learn = std::function<void(GradientSharing* sharing, LearnerState& state)>;

  /// Returns whether gradients are shared at each step, instead of parameters once an update.
  virtual bool each_step() const = 0;
  /// Calls `learn` and waits for the others; `state` is that before. Puts what all have together into what `state`
  /// shares (is_shared()): the average, weighted by steps. Throws Error when this trainer cannot go on with the others,
  /// and what ends a waiting.
  virtual SharedUpdate share(const LocalUpdate& mine, const Learn& learn, LearnerState& state) = 0;
};

}  // namespace citylearn
