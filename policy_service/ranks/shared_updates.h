// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/learning/update_sharing.h"
#include "policy_service/ranks/rank_group.h"

namespace citylearn {

/// Averages parameters and moments over the ranks once an update, weighted by the steps that each has learned from. An
/// averaging that fails because a rank is lost is repeated by the others, so that only its own work is lost, and no
/// step counts twice. Or averages gradients at each step, as one learner with all the ranks' minibatches.
class SharedUpdates : public UpdateSharing {
 public:
  /// `group` must outlive it.
  explicit SharedUpdates(RankGroup& group, bool each_step = false) : group_(group), each_step_(each_step) {}

  bool each_step() const override { return each_step_; }
  SharedUpdate share(const LocalUpdate& mine, const Learn& learn, LearnerState& state) override;
  /// Returns whether this is the lowest rank of the last update: the one that writes what the run leaves behind.
  bool lowest() const { return lowest_; }
  int members() const { return members_; }  ///< of the last update

 private:
  std::uint64_t learn_together(const RankMeeting& meeting, const Learn& learn, LearnerState& state);

  RankGroup& group_;
  const bool each_step_;
  bool lowest_ = false;
  int members_ = 0;
};

}  // namespace citylearn
