// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core.hpp>

namespace citylearn {

/// Lies in memory as pictures do, row by row.
using RowMajorXf = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// The gradient of each pixel of a picture, by central differences with repeated borders.
struct Gradients {
  cv::Mat magnitude;
  cv::Mat angle;  ///< 0..2 pi
};
/// Returns the gradients, CV_32F, of `grey`, CV_32F.
Gradients gradients_of(const cv::Mat& grey);

/// Divides magnitudes between orientations: linear interpolation between the two nearest bins.
struct OrientationBins {
  int bins = 8;      ///< at least 2, the circle or half of it
  float scale = 1;   ///< bins a radian
  float offset = 0;  ///< place of the angle 0 in bins; angles times scale and this are in 0..3 times `bins`

  /// Writes what the gradient gives its two bins; `to` has `bins` numbers, zeros before.
  void put(float magnitude, float angle, float* to) const {
    const float position = angle * scale + offset;
    const int lower = static_cast<int>(position);
    const float share = magnitude * (position - static_cast<float>(lower));
    int first = lower >= bins ? lower - bins : lower;
    first = first >= bins ? first - bins : first;
    to[first] = magnitude - share;
    to[first + 1 == bins ? 0 : first + 1] = share;
  }
};

}  // namespace citylearn
