// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/lab/recognition/evaluation.h"
#include "tools/lab/recognition/similarity.h"

namespace citylearn::lab {

/// Options for turning features into answers.
struct MatchingOptions {
  Measure measure = Measure::kCosine;
  int sequence = 21;   ///< frames of "sequence"; "seqslam" has one less before and after, as its length is even
  int past = 5;        ///< frames before the query of "past"
  double slowest = 1;  ///< reference frames per query frame, for "sequence" and "past"
  double fastest = 1;
  int window = 10;      ///< of the local contrast
  int neighbours = 10;  ///< of CSLS
  int hidden = 64;      ///< of the classifier
  int epochs = 200;
  std::uint64_t seed = 1;
  int overview = 0;  ///< pixels a side of Result::overview, at most; 0: none
};

/// A chain of steps, "csls+sequence": a source of similarities (nearest or mlp; nearest when none is named), then any
/// of csls, contrast, sequence, past in the order given, then perhaps seqslam.
class Method {
 public:
  /// Throws Error: unknown steps, or a step where it cannot stand.
  explicit Method(const std::string& chain);

  const std::string& name() const { return name_; }
  struct Result {
    Answers answers;
    /// The scores after all steps, a query a column; each entry the greatest of its block, so that thin lines stay
    /// visible.
    Eigen::MatrixXf overview;
  };
  /// `reference` D x R, `query` D x Q. Throws Error, Stopped.
  Result run(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, const GroundTruth& truth,
             const MatchingOptions& options) const;

 private:
  std::string name_;
  std::vector<std::string> steps_;  // the first is nearest or mlp
};

}  // namespace citylearn::lab
