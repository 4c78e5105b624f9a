// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>
#include <vector>

namespace citylearn {

struct DenseSiftOptions {
  int step = 4;  ///< pixels between descriptors, across and down
  int bin = 8;   ///< pixels; a descriptor looks at 4 x 4 bins
};

/// Descriptors of a grid of patches of one picture.
struct LocalDescriptors {
  Eigen::MatrixXf values;            ///< 128 x n, each of length 1 (or zeros in a patch without any texture)
  std::vector<cv::Point2f> centres;  ///< n, pixels
};

/// Returns how many descriptors a picture of this size has, both sides at least 4 bins.
int dense_sift_count(cv::Size size, const DenseSiftOptions& options);

/// Returns SIFT descriptors (Lowe, IJCV 2004: 4 x 4 bins of 8 orientations, interpolated, clipped at 0.2) on a grid,
/// upright, square-rooted (RootSIFT: Arandjelovic & Zisserman, CVPR 2012). No Gaussian over the patch: bins count
/// alike.
/// `grey`: CV_32F, both sides at least 4 bins.
LocalDescriptors dense_root_sift(const cv::Mat& grey, const DenseSiftOptions& options);

}  // namespace citylearn
