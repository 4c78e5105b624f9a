// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/picture_descriptor.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "core/wire/service.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr int kAcross = 8, kDown = 4, kCell = 8, kBins = 8;
static_assert(kDescriptorColumn == kDown * kBins);
constexpr float kFloor = 1;    // keeps cells without texture from becoming all noise; in gradients of roots of grey
constexpr float kClip = 0.4F;  // of a cell normalised with its neighbours

/// Calls visit(first number of the cell) for each cell that touches (column, row) of the grid of cells.
template <class Visit>
void cells_about(int column, int row, int reach, const Visit& visit) {
  for (int x = std::max(0, column - reach); x <= std::min(kAcross - 1, column + reach); ++x)
    for (int y = std::max(0, row - reach); y <= std::min(kDown - 1, row + reach); ++y)
      visit((x * kDown + y) * kBins, x, y);
}

/// As Dalal & Triggs, CVPR 2005, with each cell normalised by its neighbourhood once.
Eigen::VectorXf describe(const cv::Mat& picture) {
  cv::Mat grey, right, down;
  cv::resize(picture, grey, cv::Size(kAcross * kCell, kDown * kCell), 0, 0, cv::INTER_AREA);
  cv::cvtColor(grey, grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(grey, CV_32F);
  cv::sqrt(grey, grey);  // compresses bright edges
  cv::Sobel(grey, right, CV_32F, 1, 0, 1);
  cv::Sobel(grey, down, CV_32F, 0, 1, 1);
  Eigen::VectorXf sums = Eigen::VectorXf::Zero(kAcross * kDown * kBins), result = sums;
  for (int y = 0; y < grey.rows; ++y)
    for (int x = 0; x < grey.cols; ++x) {
      const float dx = right.at<float>(y, x), dy = down.at<float>(y, x), magnitude = std::hypot(dx, dy);
      const float angle = std::atan2(dy, dx) / std::numbers::pi_v<float> + (dy < 0 ? 1 : 0);  // of a line: 0..1
      const int bin = static_cast<int>(angle * kBins);
      const float share = angle * kBins - static_cast<float>(bin);
      const auto distance = [](int pixel, int cell) {  // from the cell's middle, in cells
        return std::abs((static_cast<float>(pixel) + 0.5F) / kCell - static_cast<float>(cell) - 0.5F);
      };
      cells_about(x / kCell, y / kCell, 1, [&](int at, int column, int row) {
        const float weight = magnitude * std::max(0.F, 1 - distance(x, column)) * std::max(0.F, 1 - distance(y, row));
        sums[at + bin % kBins] += weight * (1 - share);
        sums[at + (bin + 1) % kBins] += weight * share;
      });
    }
  cells_about(kAcross / 2, kDown / 2, kAcross, [&](int at, int column, int row) {
    float energy = 0;
    cells_about(column, row, 1, [&](int near, int, int) { energy += sums.segment<kBins>(near).squaredNorm(); });
    result.segment<kBins>(at) =
        (sums.segment<kBins>(at) / (std::sqrt(energy) + kFloor)).cwiseMin(kClip).cwiseMax(0).cwiseSqrt();
  });
  return result;
}

}  // namespace

Eigen::MatrixXf describe_pictures(Images& images, const std::vector<int>& frames) {
  Eigen::MatrixXf result = Eigen::MatrixXf::Zero(kAcross * kDescriptorColumn, static_cast<Eigen::Index>(frames.size()));
  Bytes bytes;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    if (stop_requested()) throw Error("stopped before all pictures were looked at", images.name(frames[i]));
    try {
      images.read(frames[i], bytes);
      result.col(static_cast<Eigen::Index>(i)) = describe(decode_image(bytes, images.name(frames[i])));
    } catch (const Error&) {  // select() says so of the frames that are to be shown
    }
  }
  return result;
}

}  // namespace citylearn
