// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/pictures.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "encoder_service/encoding/picture_encoder.h"
#include "tools/lab/descriptors.h"

namespace citylearn::vpr {
namespace {

constexpr int kWidth = 160, kBorder = 4, kGap = 6;  // pixels: of a picture, of its frame, between frames

}  // namespace

std::string matches_jpeg(const Traversal& reference, const Traversal& query, const Answers& answers,
                         const GroundTruth& truth, int most) {
  const cv::Scalar white(255, 255, 255), green(0, 160, 0), red(0, 0, 220);
  const int columns = std::min(most, query.frames);
  const cv::Mat first = lab::read_picture(query, 0);
  const int height = std::clamp(kWidth * first.rows / first.cols, 1, 2 * kWidth);
  const int across = kWidth + 2 * kBorder + kGap, down = height + 2 * kBorder + kGap;
  cv::Mat sheet(3 * down, columns * across, CV_8UC3, white);
  const auto show = [&](int row, int column, const Traversal& traversal, int frame, const cv::Scalar& colour) {
    if (frame < 0) return;
    const cv::Rect place(column * across, row * down, kWidth + 2 * kBorder, height + 2 * kBorder);
    sheet(place).setTo(colour);
    const cv::Mat inside = sheet(place)(cv::Rect(kBorder, kBorder, kWidth, height));
    scaled(lab::read_picture(traversal, frame), kWidth, height).copyTo(inside);
  };
  for (int column = 0; column < columns; ++column) {
    const int q = static_cast<int>((2 * static_cast<long>(column) + 1) * query.frames / (2 * columns));
    show(0, column, query, q, white);
    show(1, column, reference, answers.nearest[q], answers.rank[q] == 0 ? green : red);
    show(2, column, reference, truth.place(q), white);
  }
  std::vector<std::uint8_t> file;
  cv::imencode(".jpg", sheet, file);
  return {file.begin(), file.end()};
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
