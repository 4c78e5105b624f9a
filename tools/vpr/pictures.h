// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>

#include "env_service/dataset_io/traversal.h"
#include "tools/lab/recognition/evaluation.h"

namespace citylearn::vpr {

/// Returns a JPEG of up to `most` queries spread over the traversal, a column each: the query's picture, the most
/// similar one of the reference in a frame (green when it is right, red when it is wrong), and a right one. What does
/// not exist is left white. Both traversals must have pictures. Throws Error, Stopped.
std::string matches_jpeg(const Traversal& reference, const Traversal& query, const Answers& answers,
                         const GroundTruth& truth, int most = 12);

/// Returns a PNG of an R x Q matrix, a query a column: dark to bright from the 1st to the 99th percentile of its finite
/// entries, at most `most` pixels a side (a pixel is then the greatest entry of its block, so that thin lines
/// stay visible).
std::string matrix_png(const Eigen::Ref<const Eigen::MatrixXf>& matrix, int most = 1024);

}  // namespace citylearn::vpr
