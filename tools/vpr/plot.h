// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace citylearn::vpr {

/// A line of a plot, of precision over recall.
struct Curve {
  std::string label;
  std::vector<double> recall, precision;
};

/// An SVG of precision over recall, 0..1 each, with axes, grid and a legend; it reads on light and on dark grounds.
/// Up to eight colours, then dashes. Labels may hold any text.
std::string precision_recall_svg(const std::string& title, const std::vector<Curve>& curves);

/// A PNG of an R x Q matrix, a query a column: dark to bright from the 1st to the 99th percentile of its finite
/// entries, at most `most` pixels a side (a pixel is then the greatest entry of its block, so that a thin line
/// survives).
std::string matrix_png(const Eigen::Ref<const Eigen::MatrixXf>& matrix, int most = 1024);

}  // namespace citylearn::vpr
