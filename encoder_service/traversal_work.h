// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/util/types.h"
#include "encoder_service/feature_store.h"

namespace citylearn {

/// Tracks which descriptors of one traversal exist and which are still to be made, and by which process. Several
/// processes that share a store divide the frames: each reserves a block, makes what is missing in it, and takes what
/// others made from the store.
class TraversalWork {
 public:
  static constexpr int kBlock = 64;  ///< frames reserved together

  /// `folder` of the store; empty: descriptors are kept in memory alone. Throws Error.
  TraversalWork(const std::string& folder, const FeatureStore::Key& key);

  /// Reserves a block for the caller, until all of its frames are put() or put_bad(), and returns its frames that are
  /// not made yet; nothing when all that is left is reserved by others (ask again later) or none is left. The search
  /// begins at frame `begin`.
  std::optional<std::vector<int>> reserve(int begin);
  void put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  /// Notes that the frame cannot be encoded.
  void put_bad(int frame);

  bool complete() const { return done_ == key_.frames; }
  int done() const { return done_; }
  int frames() const { return key_.frames; }
  /// Returns how many of those done were made by this object.
  int made() const { return made_; }
  const std::vector<int>& bad() const { return bad_; }

  /// Returns the D x F descriptors, once complete, and frees them here; bad frames have their nearest good neighbour's.
  /// Throws Error when no frame is good or the store lost a frame.
  Eigen::MatrixXf take_descriptors();

 private:
  void look_into_store();
  void release_finished_blocks();

  FeatureStore::Key key_;
  std::unique_ptr<FeatureStore> store_;
  Eigen::MatrixXf memory_;  // D x F when there is no store
  std::vector<bool> have_;  // done: made, found in the store, or bad
  std::vector<int> bad_;
  int done_ = 0, made_ = 0;
  std::map<int, std::unique_ptr<FeatureStore::Claim>> blocks_;  // reserved, by first frame; null without a store
  Clock::time_point looked_{};
};

}  // namespace citylearn
