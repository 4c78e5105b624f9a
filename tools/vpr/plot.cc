// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/plot.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "tools/chart/chart.h"

namespace citylearn::vpr {
namespace {

constexpr double kPixels = 420;  // a side of the plot

}  // namespace

std::string precision_recall_svg(const std::string& title, const std::vector<Curve>& curves) {
  Chart chart{title, {"recall", 0, 1}, {"precision", 0, 1}, {}};
  chart.width = chart.height = kPixels;
  for (const Curve& curve : curves) {
    Line& line = chart.lines.emplace_back(Line{curve.label, {}, {}});
    if (curve.recall.empty()) continue;
    line.x = {0};
    line.y = {curve.precision.front()};
    for (std::size_t i = 0; i < curve.recall.size(); ++i) {
      // Points closer than a pixel to the last one drawn say nothing new.
      const double step = std::hypot(curve.recall[i] - line.x.back(), curve.precision[i] - line.y.back());
      if (step * kPixels < 0.7 && i + 1 < curve.recall.size()) continue;
      line.x.push_back(curve.recall[i]);
      line.y.push_back(curve.precision[i]);
    }
  }
  return svg_of(chart);
}

std::string matrix_png(const Eigen::Ref<const Eigen::MatrixXf>& matrix, int most) {
  const Eigen::Index block = std::max<Eigen::Index>(1, (std::max(matrix.rows(), matrix.cols()) + most - 1) / most);
  const Eigen::Index rows = (matrix.rows() + block - 1) / block, columns = (matrix.cols() + block - 1) / block;
  std::vector<float> finite;
  Eigen::MatrixXf small(rows, columns);
  for (Eigen::Index c = 0; c < columns; ++c)
    for (Eigen::Index r = 0; r < rows; ++r) {
      const float value = matrix
                              .block(r * block, c * block, std::min(block, matrix.rows() - r * block),
                                     std::min(block, matrix.cols() - c * block))
                              .maxCoeff();
      small(r, c) = value;
      if (std::isfinite(value)) finite.push_back(value);
    }
  float low = 0, high = 1;
  if (!finite.empty()) {
    const auto at = [&](double share) {
      const auto middle = finite.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(finite.size() - 1));
      std::nth_element(finite.begin(), middle, finite.end());
      return *middle;
    };
    low = at(0.01);
    high = at(0.99);
  }
  const float scale = high > low ? 255 / (high - low) : 0;
  cv::Mat grey(static_cast<int>(rows), static_cast<int>(columns), CV_8U), colour;
  for (int c = 0; c < grey.cols; ++c)
    for (int r = 0; r < grey.rows; ++r) {
      const float level = (small(r, c) - low) * scale;
      grey.at<std::uint8_t>(r, c) = std::isnan(level) ? 0 : static_cast<std::uint8_t>(std::clamp(level, 0.0f, 255.0f));
    }
  try {
    cv::applyColorMap(grey, colour, cv::COLORMAP_VIRIDIS);
    std::vector<std::uint8_t> file;
    cv::imencode(".png", colour, file);
    return {file.begin(), file.end()};
  } catch (const cv::Exception& error) {
    throw Error("the picture of the similarities cannot be made: " + error.err);
  }
}

}  // namespace citylearn::vpr
