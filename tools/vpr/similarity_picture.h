// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>

namespace citylearn::vpr {

/// A PNG of an R x Q matrix, a query a column: dark to bright from the 1st to the 99th percentile of its finite
/// entries, at most `most` pixels a side (a pixel is then the greatest entry of its block, so that thin lines
/// stay visible).
std::string matrix_png(const Eigen::Ref<const Eigen::MatrixXf>& matrix, int most = 1024);

}  // namespace citylearn::vpr
