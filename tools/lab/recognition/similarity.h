// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>

#include "tools/lab/recognition/scores.h"

namespace citylearn {

/// Measures of similarity of two features. Larger is always nearer.
enum class Measure {
  kCosine,  ///< of the angle between them, -1..1; a feature of zeros is 0 from everything
  kL1,      ///< minus the sum of their absolute differences: what SeqSLAM compares images by
};
/// Parses "cosine" or "l1". Throws Error listing them.
Measure measure_of(const std::string& name);

/// Returns the similarities of D x R reference features and D x Q query features, which must outlive them. Throws Error
/// when the dimensions differ.
Scores similarity(const Eigen::MatrixXf& reference, const Eigen::MatrixXf& query, Measure measure);

/// Cross-domain similarity local scaling (Conneau et al., ICLR 2018, section 2.3): 2 s(r, q) - m(r) - m(q), where m is
/// a frame's mean similarity to its `neighbours` nearest ones on the other side. A reference frame that is near to many
/// queries (a hub) loses. Reads all similarities at once. `neighbours` beyond R or Q counts as R or Q.
Scores csls(Scores scores, int neighbours = 10);

}  // namespace citylearn
