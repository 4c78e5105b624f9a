// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace citylearn {

/// Turns each channel g of a picture into (g - mean) / sqrt(variance + 16) under a Gaussian window, which removes slow
/// changes of light and of contrast. Immutable once made.
class SlidingNormalisation {
 public:
  /// `sigma`: of the window, pixels.
  SlidingNormalisation(cv::Size size, double sigma);
  /// Returns the normalised picture; `picture`: float, 0..255, any channels, of this size.
  cv::Mat apply(const cv::Mat& picture) const;

 private:
  // The window's weights: columns of pixels are multiplied by the one, rows by the other. It is as wide as a good part
  // of the picture, so products of matrices are quicker than filters.
  Eigen::MatrixXf down_, across_;
};

}  // namespace citylearn
