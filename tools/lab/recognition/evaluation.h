// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <utility>
#include <vector>

#include "tools/lab/recognition/scores.h"

namespace citylearn {

/// Which reference frames are right answers to which queries: those within `tolerance` frames of a frame that shows the
/// same place.
class GroundTruth {
 public:
  /// Query frame i shows the place of reference frame i.
  static GroundTruth by_index(int references, int queries, int tolerance);
  /// Pairs (reference frame, query frame) of the same place, in any order, several for a query allowed. Throws Error
  /// when one is outside.
  static GroundTruth by_matches(const std::vector<std::pair<int, int>>& matches, int references, int queries,
                                int tolerance);

  /// Judges no answer to this query, as nothing is known of its place.
  void leave_out(int query);
  /// Takes this reference frame for no answer, likewise.
  void leave_out_reference(int reference) { unplaced_references_.push_back(reference); }

  int references() const { return references_; }
  int queries() const { return static_cast<int>(frames_.size()); }
  int tolerance() const { return tolerance_; }
  /// Returns all right reference frames, ascending.
  std::vector<int> right_frames(int query) const;
  /// Returns whether any reference frame is right. Other queries do not count for recall; accepting them is an error.
  bool answerable(int query) const;
  const std::vector<int>& unplaced_references() const { return unplaced_references_; }
  bool left_out(int query) const { return left_out_[static_cast<std::size_t>(query)]; }
  /// Returns a frame that shows the same place, of several the middle one; -1: none.
  int place(int query) const;

 private:
  int references_ = 0, tolerance_ = 0;
  std::vector<std::vector<int>> frames_;  // by query: sorted reference frames of the same place
  std::vector<bool> left_out_;            // by query
  std::vector<int> unplaced_references_;
};

/// The answers of a similarity matrix to each query.
struct Answers {
  std::vector<int> nearest;       ///< the most similar reference frame (the first of equals); -1: none, or left out
  std::vector<float> confidence;  ///< its similarity; -infinity: none
  /// Wrong frames at least as similar as the most similar right one: 0 is a recognised place. An equal wrong frame
  /// counts, so that a constant matrix recognises nothing. kNever when no right frame is finite.
  std::vector<int> rank;
  std::vector<bool> answerable;

  static constexpr int kNever = 1 << 30;
  int queries() const { return static_cast<int>(rank.size()); }
};
/// Larger scores are nearer; -infinity and NaN are not answers. Throws Error when they do not fit `truth`.
Answers answers(const Scores& scores, const GroundTruth& truth);

/// Returns the share of answerable queries with a right frame among the n most similar ones; NaN when there are none.
double recall_at(const Answers& answers, int n);

struct Interval {
  double low = 0, high = 1;
};
/// 95 % of a share of `successes` out of `trials` independent ones (Wilson, JASA 1927). Neighbouring frames of a
/// recording are not independent, so the truth is somewhat wider.
Interval wilson_interval(double successes, double trials);

/// Precision and recall of "accept the answers with at least this confidence", one point per distinct confidence, most
/// confident first. Precision = right / accepted, recall = right / answerable queries: the last recall is recall@1.
struct PrecisionRecall {
  std::vector<double> confidence, precision, recall;
  /// Area under precision over recall: trapezoids between the points, from recall 0 with the first point's precision to
  /// the last recall. Never more than recall@1.
  double auc = 0;
  /// Greatest recall at which precision is still 1.
  double recall_at_full_precision = 0;
};
PrecisionRecall precision_recall(const Answers& answers);

/// 95 % of the AUC, by resampling queries in circular blocks of about sqrt(Q) neighbours, as neighbours are alike
/// (circular block bootstrap: Politis & Romano, 1992; percentiles).
Interval auc_interval(const Answers& answers, std::uint64_t seed, int resamples = 500);

}  // namespace citylearn
