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

/// Which descriptors of one traversal there are and which are to be made, by whom. Several processes that share a store
/// divide the frames among themselves: each reserves a block, makes what is missing in it, and takes what others made
/// from the store.
class TraversalWork {
 public:
  static constexpr int kBlock = 64;  ///< frames reserved together

  /// `folder` of the store; empty: descriptors are kept in memory alone. Throws Error.
  TraversalWork(const std::string& folder, const FeatureStore::Key& key);

  /// Frames of a block not yet made, now reserved for the caller until they are all put() or marked bad; nothing when
  /// all that is left is in other hands (ask again later) or there is none left. `begin` is where looking begins.
  std::optional<std::vector<int>> reserve(int begin);
  void put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  /// The frame cannot be encoded.
  void put_bad(int frame);

  bool complete() const { return done_ == key_.frames; }
  int done() const { return done_; }
  int frames() const { return key_.frames; }
  /// Of those done, made by this object.
  int made() const { return made_; }
  const std::vector<int>& bad() const { return bad_; }

  /// D x F, once complete; bad frames have their nearest good neighbour's. What memory held for it is let go. Throws
  /// Error when no frame is good, or the store lost what it had.
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
