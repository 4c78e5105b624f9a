// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>

namespace citylearn {

/// R x Q similarities of reference frames and queries. They are computed a block at a time, whenever one is read: those
/// of 36,000 x 36,000 frames, 5 GB, are never held together.
class Scores {
 public:
  /// Fills in the block whose first entry is of this reference frame and this query.
  using Read = std::function<void(Eigen::Index reference, Eigen::Index query, Eigen::Ref<Eigen::MatrixXf> block)>;
  Scores(Eigen::Index references, Eigen::Index queries, Read read)
      : references_(references), queries_(queries), read_(std::move(read)) {}
  /// Scores that are held.
  Scores(Eigen::MatrixXf matrix);  // NOLINT(google-explicit-constructor)

  Eigen::Index references() const { return references_; }
  Eigen::Index queries() const { return queries_; }
  void read(Eigen::Index reference, Eigen::Index query, const Eigen::Ref<Eigen::MatrixXf>& block) const {
    read_(reference, query, block);
  }
  /// Calls `take` for one block of queries after the other, with its first query and `count` references from `first`.
  using Take = std::function<void(Eigen::Index query, const Eigen::MatrixXf& block)>;
  void for_each_block(Eigen::Index first, Eigen::Index count, const Take& take) const;
  void for_each_block(const Take& take) const { for_each_block(0, references_, take); }
  /// Returns all of them.
  Eigen::MatrixXf matrix() const;
  /// Returns scores that are quick to read again: held, where that takes no more than 128 MB.
  Scores cached() const;

 private:
  Eigen::Index references_, queries_;
  Read read_;
};

/// References and queries around an entry that a step needs to compute it.
struct Margin {
  Eigen::Index references = 0;         ///< on either side
  Eigen::Index before = 0, after = 0;  ///< queries
};
/// Returns a block of the same size, given one with its first reference and query. Blocks have the margin, except at
/// the edges of all scores.
using Step = std::function<Eigen::MatrixXf(const Eigen::MatrixXf& block, Eigen::Index reference, Eigen::Index query)>;
/// Returns what `step` makes of the scores.
Scores transformed(Scores scores, const Margin& margin, Step step);

/// Frames `first`, first + 1 ...
struct FrameRange {
  Eigen::Index first = 0, count = 0;
};
/// Returns the least range around `range` for which Eigen's products and reductions give the bits that they give for
/// all `total` frames: kernels take 48 rows or 4 columns at once and treat the rest of a matrix in other ways.
FrameRange whole_kernels(FrameRange range, Eigen::Index total);

}  // namespace citylearn
