// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "core/util/types.h"
#include "encoder_service/pipeline/block_division.h"
#include "encoder_service/pipeline/feature_store.h"

namespace citylearn {

/// Tracks which descriptors of one traversal exist and which this process is to make. Processes of one session divide
/// the blocks by BlockDivision. Those that share a store, of other sessions too, also reserve blocks by file locks, and
/// take from it what others made. Used by one thread, apart from the longer read().
class TraversalWork {
 public:
  /// `folder` of the store; empty: descriptors are kept in memory alone. Throws Error.
  TraversalWork(const std::string& folder, const FeatureStore::Key& key, BlockDivision& division);

  /// Begins a block and returns its frames to be made; empty: there is none for this process now.
  std::vector<int> begin(Clock::time_point now);
  /// Returns frames in blocks that are others' by now: those not begun yet need not be made.
  std::vector<int> take_lost();
  /// Gives all blocks back, and returns their frames that are not done.
  std::vector<int> give_back();

  void put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  /// Puts a descriptor that another process made.
  void put_fetched(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  /// Notes that the frame cannot be encoded.
  void put_bad(int frame);
  /// Takes what another process wrote of a block into the same store.
  void look_for(int block);
  /// Reads a descriptor that is present; returns false when it was lost.
  bool read(int frame, std::span<float> descriptor) const;

  bool complete() const { return done_ == key_.frames; }
  int done() const { return done_; }
  int frames() const { return key_.frames; }
  const FeatureStore::Key& key() const { return key_; }
  int made() const { return made_; }        ///< of those done, by this object
  int fetched() const { return fetched_; }  ///< of those done, from other processes over the wire
  const std::vector<int>& bad() const { return bad_; }
  /// Return a bit a frame, by block: frames whose descriptors are here, and frames that are not done.
  std::span<const std::uint64_t> present() const { return present_; }
  std::span<const std::uint64_t> lacking() const { return lacking_; }

  /// Reads the descriptors of these frames, a column each, once complete; bad ones have their nearest good neighbour's.
  /// Adds frames that the store has lost, as after a loss of power where it lies, to `lost`. Throws Error when no frame
  /// is good. May run on another thread.
  void read(std::span<const int> frames, Eigen::Ref<Eigen::MatrixXf> descriptors, std::vector<int>& lost) const;
  /// Notes that frames are to be made again.
  void lose(const std::vector<int>& frames);

 private:
  void look_into_store(bool trust = false);
  void note_done(int frame, bool present);
  int take(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  void release_finished_blocks();
  std::vector<int> lacking_frames(int block) const;
  std::vector<int> drop(const std::vector<int>& blocks);
  bool reserve(int block);
  bool is_lacking(int frame) const;

  const FeatureStore::Key key_;
  BlockDivision& division_;
  std::unique_ptr<FeatureStore> store_;
  std::unique_ptr<Eigen::MatrixXf> memory_;  // D x F; without a store only
  std::vector<std::uint64_t> present_, lacking_;
  std::vector<int> bad_;
  int done_ = 0, made_ = 0, fetched_ = 0;
  std::map<int, std::unique_ptr<FeatureStore::Claim>> locks_;  // by block, with a store
  Clock::time_point looked_{};
};

}  // namespace citylearn
