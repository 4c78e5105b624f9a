// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/dense_sift.h"

#include <algorithm>
#include <opencv2/imgproc.hpp>

namespace citylearn {
namespace {

constexpr int kOrientations = 8;
constexpr int kBins = 4;  // along a side
constexpr int kSize = kBins * kBins * kOrientations;

/// The gradient's magnitude in the channels of its two nearest orientations, zero in the others.
cv::Mat orientation_maps(const cv::Mat& grey) {
  cv::Mat dx, dy, magnitude, angle;
  const cv::Matx13f difference(-1, 0, 1);
  cv::filter2D(grey, dx, CV_32F, difference, {-1, -1}, 0, cv::BORDER_REPLICATE);
  cv::filter2D(grey, dy, CV_32F, difference.t(), {-1, -1}, 0, cv::BORDER_REPLICATE);
  cv::cartToPolar(dx, dy, magnitude, angle);
  cv::Mat maps = cv::Mat::zeros(grey.size(), CV_32FC(kOrientations));
  for (int y = 0; y < grey.rows; ++y) {
    float* at = maps.ptr<float>(y);
    for (int x = 0; x < grey.cols; ++x, at += kOrientations) {
      const float position = angle.at<float>(y, x) * static_cast<float>(kOrientations / (2 * CV_PI));
      const int lower = static_cast<int>(position);
      const float share = magnitude.at<float>(y, x) * (position - static_cast<float>(lower));
      at[lower % kOrientations] += magnitude.at<float>(y, x) - share;
      at[(lower + 1) % kOrientations] += share;
    }
  }
  return maps;
}

}  // namespace

LocalDescriptors dense_root_sift(const cv::Mat& grey, const DenseSiftOptions& options) {
  const int bin = options.bin, patch = kBins * bin;
  CV_Assert(grey.type() == CV_32F && grey.cols >= patch && grey.rows >= patch && options.step > 0 && bin > 1);
  // A box twice is a triangle: linear interpolation between the middles of bins. An even box is off its middle by half
  // a pixel, so the second one is off to the other side.
  cv::Mat maps = orientation_maps(grey), sums;
  cv::boxFilter(maps, sums, -1, {bin, bin}, {bin / 2, bin / 2}, true, cv::BORDER_CONSTANT);
  cv::boxFilter(sums, maps, -1, {bin, bin}, {(bin - 1) / 2, (bin - 1) / 2}, true, cv::BORDER_CONSTANT);

  const int across = (grey.cols - patch) / options.step + 1, down = (grey.rows - patch) / options.step + 1;
  // The rest of the grid is divided between both borders.
  const int left = (grey.cols - patch) % options.step / 2, top = (grey.rows - patch) % options.step / 2;
  LocalDescriptors result;
  result.values.resize(kSize, static_cast<Eigen::Index>(across) * down);
  result.centres.reserve(static_cast<std::size_t>(across) * down);
  for (int row = 0; row < down; ++row)
    for (int column = 0; column < across; ++column) {
      const int x = left + column * options.step, y = top + row * options.step;
      auto descriptor = result.values.col(static_cast<Eigen::Index>(result.centres.size()));
      float* to = descriptor.data();
      for (int v = 0; v < kBins; ++v)
        for (int u = 0; u < kBins; ++u, to += kOrientations)
          std::copy_n(maps.ptr<float>(y + v * bin + bin / 2) + (x + u * bin + bin / 2) * kOrientations, kOrientations,
                      to);
      descriptor = descriptor.cwiseMax(0.f);  // running sums may end a rounding below zero
      descriptor /= descriptor.norm() + 1e-3f;
      descriptor = descriptor.cwiseMin(0.2f);
      descriptor = (descriptor / (descriptor.sum() + 1e-6f)).cwiseSqrt().eval();
      result.centres.emplace_back(static_cast<float>(x) + static_cast<float>(patch) / 2,
                                  static_cast<float>(y) + static_cast<float>(patch) / 2);
    }
  return result;
}

}  // namespace citylearn
