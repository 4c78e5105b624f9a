// SPDX-License-Identifier: Apache-2.0
// Histograms of gradients by their definitions, pixel after pixel, beside those of the encoders.
#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/imgproc.hpp>

#include "encoder_service/encoding/dense_sift.h"
#include "encoder_service/encoding/encoder.h"
#include "tests/support/data/sample_pictures.h"

namespace citylearn::testing {
namespace {

using Eigen::ArrayXf;
using Eigen::Index;

cv::Mat grey_picture(int width, int height, std::uint64_t seed) {
  cv::Mat grey;
  cv::cvtColor(drawn_picture(width, height, seed), grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(grey, CV_32F);
  return grey;
}

/// Adds the gradient at a pixel, shared between its two nearest orientations. `bins` divide `range` radians; the middle
/// of the first one is at `middle` bins.
void add_gradient(const cv::Mat& grey, int x, int y, double range, double middle, float weight,
                  Eigen::Ref<ArrayXf> to) {
  const auto at = [&](int column, int row) {
    return grey.at<float>(std::clamp(row, 0, grey.rows - 1), std::clamp(column, 0, grey.cols - 1));
  };
  const double dx = at(x + 1, y) - at(x - 1, y), dy = at(x, y + 1) - at(x, y - 1);
  const int bins = static_cast<int>(to.size());
  const double position = std::fmod(std::atan2(dy, dx) / range * bins - middle + 4 * bins, bins);
  const int lower = static_cast<int>(position);
  const double share = position - lower, magnitude = weight * std::hypot(dx, dy);
  to(lower % bins) += static_cast<float>(magnitude * (1 - share));
  to((lower + 1) % bins) += static_cast<float>(magnitude * share);
}

TEST(DenseSift, IsWhatItsDefinitionSays) {
  for (const DenseSiftOptions options :
       {DenseSiftOptions{.step = 4, .bin = 8}, {.step = 3, .bin = 5}, {.step = 7, .bin = 4}}) {
    const cv::Mat grey = grey_picture(61, 47, 6);
    cv::Mat maps = cv::Mat::zeros(grey.size(), CV_32FC(8)), boxes;
    for (int y = 0; y < grey.rows; ++y)
      for (int x = 0; x < grey.cols; ++x)
        add_gradient(grey, x, y, 2 * CV_PI, 0, 1, Eigen::Map<ArrayXf>(maps.ptr<float>(y) + 8 * x, 8));
    const int bin = options.bin;
    cv::boxFilter(maps, boxes, -1, {bin, bin}, {bin / 2, bin / 2}, true, cv::BORDER_CONSTANT);
    cv::boxFilter(boxes, maps, -1, {bin, bin}, {(bin - 1) / 2, (bin - 1) / 2}, true, cv::BORDER_CONSTANT);
    const LocalDescriptors local = dense_root_sift(grey, options);
    ASSERT_EQ(local.values.cols(), dense_sift_count(grey.size(), options));
    for (Index i = 0; i < local.values.cols(); ++i) {
      const cv::Point2f centre = local.centres[static_cast<std::size_t>(i)];
      const int left = static_cast<int>(centre.x) - 2 * bin, top = static_cast<int>(centre.y) - 2 * bin;
      ArrayXf expected(128);
      for (int v = 0; v < 4; ++v)
        for (int u = 0; u < 4; ++u)
          expected.segment(8 * (4 * v + u), 8) =
              Eigen::Map<const ArrayXf>(maps.ptr<float>(top + v * bin + bin / 2) + 8 * (left + u * bin + bin / 2), 8);
      expected = (expected / (expected.matrix().norm() + 1e-3f)).min(0.2f);
      expected = (expected / (expected.sum() + 1e-6f)).max(0).sqrt();
      // The root of a number near zero shows its rounding.
      EXPECT_LT((local.values.col(i).array() - expected).abs().maxCoeff(), 3e-3f) << i << ", bin " << bin;
      EXPECT_LT((local.values.col(i).array().square() - expected.square()).abs().maxCoeff(), 1e-5f) << i;
    }
  }
}

TEST(Hog, IsWhatItsDefinitionSays) {
  const int across = 5, down = 3, bins = 9;
  const cv::Mat picture = drawn_picture(8 * across, 8 * down, 7);
  cv::Mat grey;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(grey, CV_32F);
  cv::sqrt(grey, grey);
  const auto& entry = EncoderRegistry::instance().find("encoder", "hog");
  const auto hog =
      entry.create(Parameters("hog", entry.parameters,
                              {{"bins", bins}, {"contrast", 0}, {"cells-across", across}, {"cells-down", down}}),
                   {});
  const Eigen::MatrixXf found = hog->encode({&picture, 1});
  ASSERT_EQ(found.rows(), (across - 1) * (down - 1) * 4 * bins);
  for (int block = 0; block < (across - 1) * (down - 1); ++block) {
    ArrayXf expected = ArrayXf::Zero(4 * bins);
    for (int y = 0; y < 16; ++y)
      for (int x = 0; x < 16; ++x)
        for (int cell = 0; cell < 4; ++cell) {
          double weight = std::exp(-(std::pow(x - 7.5, 2) + std::pow(y - 7.5, 2)) / 32);
          weight *= std::max(0., 1 - std::abs(x - 3.5 - cell % 2 * 8) / 8);
          weight *= std::max(0., 1 - std::abs(y - 3.5 - (cell < 2 ? 0 : 8)) / 8);
          add_gradient(grey, block % (across - 1) * 8 + x, block / (across - 1) * 8 + y, CV_PI, 0.5,
                       static_cast<float>(weight), expected.segment(cell * bins, bins));
        }
    expected = (expected / (expected.matrix().norm() + 0.4f * bins)).min(0.2f);
    expected /= expected.matrix().norm() + 1e-3f;
    EXPECT_LT((found.col(0).array().segment(block * 4 * bins, 4 * bins) - expected).abs().maxCoeff(), 1e-4f) << block;
  }
}

}  // namespace
}  // namespace citylearn::testing
