// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/dense_sift.h"

#include <algorithm>
#include <numeric>

#include "encoder_service/encoding/gradients.h"

namespace citylearn {
namespace {

using Eigen::Index;

constexpr int kOrientations = 8;
constexpr int kBins = 4;  // along a side
constexpr int kSize = kBins * kBins * kOrientations;

/// Magnitudes of places along one axis, by orientation.
using Histograms = Eigen::Matrix<float, kOrientations, Eigen::Dynamic>;
/// Returns how many descriptors lie along an axis of `length` pixels.
int count_along(int length, const DenseSiftOptions& options) {
  return (length - kBins * options.bin) / options.step + 1;
}

/// The descriptors' grid along one axis, and the sums that they need of it: one at the middle of each of their bins.
struct Axis {
  Axis(int length, const DenseSiftOptions& options);

  int count;   ///< descriptors
  int begin;   ///< pixel at which the first one begins: the rest of the grid is divided between both borders
  int stride;  ///< pixels between sums
  /// Pixels x sums. A box twice is a triangle: linear interpolation between the middles of bins.
  Eigen::MatrixXf weights;
  std::vector<int> first, last;  ///< of the pixels with weights, by sum; `last` is one beyond
};

Axis::Axis(int length, const DenseSiftOptions& options)
    : count(count_along(length, options)),
      begin((length - kBins * options.bin) % options.step / 2),
      stride(std::gcd(options.step, options.bin)) {
  const int bin = options.bin, sums = ((count - 1) * options.step + (kBins - 1) * bin) / stride + 1;
  weights.setZero(length, sums);
  for (int sum = 0; sum < sums; ++sum) {
    const int middle = begin + bin / 2 + sum * stride;
    // An even box is off its middle by half a pixel, so the second one is off to the other side. Boxes whose middles
    // are beyond the border count as empty.
    for (int box = std::max(0, middle - (bin - 1) / 2); box <= std::min(length - 1, middle + bin / 2); ++box)
      for (int pixel = std::max(0, box - bin / 2); pixel <= std::min(length - 1, box + (bin - 1) / 2); ++pixel)
        weights(pixel, sum) += 1 / static_cast<float>(bin * bin);
    first.push_back(std::max(0, middle - bin + 1));
    last.push_back(std::min(length, middle + bin));
  }
}

/// Returns the sums at the middles of all bins, row by row: kOrientations x (down's times across's).
Histograms bin_sums(const cv::Mat& grey, const Axis& across, const Axis& down) {
  const Gradients gradients = gradients_of(grey);
  const OrientationBins orientations{.bins = kOrientations, .scale = static_cast<float>(kOrientations / (2 * CV_PI))};
  const Index width = across.weights.cols();
  RowMajorXf rows = RowMajorXf::Zero(down.weights.cols(), static_cast<Index>(grey.cols) * kOrientations);
  Eigen::RowVectorXf row(rows.cols());
  for (int y = 0; y < grey.rows; ++y) {
    const float* magnitude = gradients.magnitude.ptr<float>(y);
    const float* angle = gradients.angle.ptr<float>(y);
    row.setZero();
    for (int x = 0; x < grey.cols; ++x) orientations.put(magnitude[x], angle[x], row.data() + x * kOrientations);
    for (Index sum = 0; sum < rows.rows(); ++sum)
      if (const float weight = down.weights(y, sum); weight > 0) rows.row(sum) += weight * row;
  }
  Histograms sums(kOrientations, rows.rows() * width);
  for (Index v = 0; v < rows.rows(); ++v) {
    const Eigen::Map<const Histograms> pixels(rows.row(v).data(), kOrientations, grey.cols);
    for (Index u = 0; u < width; ++u) {
      const int first = across.first[static_cast<std::size_t>(u)];
      const int taps = across.last[static_cast<std::size_t>(u)] - first;
      sums.col(v * width + u) = pixels.middleCols(first, taps).lazyProduct(across.weights.col(u).segment(first, taps));
    }
  }
  return sums;
}

}  // namespace

int dense_sift_count(cv::Size size, const DenseSiftOptions& options) {
  return count_along(size.width, options) * count_along(size.height, options);
}

LocalDescriptors dense_root_sift(const cv::Mat& grey, const DenseSiftOptions& options) {
  const int bin = options.bin, patch = kBins * bin;
  CV_Assert(grey.type() == CV_32F && grey.cols >= patch && grey.rows >= patch && options.step > 0 && bin > 1);
  const Axis across(grey.cols, options), down(grey.rows, options);
  const Histograms sums = bin_sums(grey, across, down);
  const int step = options.step / across.stride, next_bin = bin / across.stride;  // sums between neighbours
  const Index width = across.weights.cols();
  LocalDescriptors result;
  result.values.resize(kSize, static_cast<Index>(across.count) * down.count);
  result.centres.reserve(static_cast<std::size_t>(result.values.cols()));
  for (int row = 0; row < down.count; ++row)
    for (int column = 0; column < across.count; ++column) {
      Eigen::Map<Eigen::Vector<float, kSize>> descriptor(
          result.values.col(static_cast<Index>(result.centres.size())).data());
      for (int v = 0; v < kBins; ++v)
        for (int u = 0; u < kBins; ++u)
          descriptor.segment<kOrientations>((v * kBins + u) * kOrientations) =
              sums.col((row * step + v * next_bin) * width + column * step + u * next_bin);
      descriptor = (descriptor / (descriptor.norm() + 1e-3f)).cwiseMin(0.2f);
      descriptor = (descriptor / (descriptor.sum() + 1e-6f)).cwiseSqrt();
      const float half = static_cast<float>(patch) / 2;
      result.centres.emplace_back(static_cast<float>(across.begin + column * options.step) + half,
                                  static_cast<float>(down.begin + row * options.step) + half);
    }
  return result;
}

}  // namespace citylearn
