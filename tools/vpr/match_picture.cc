// SPDX-License-Identifier: Apache-2.0
#include "tools/vpr/match_picture.h"

#include <algorithm>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

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

}  // namespace citylearn::vpr
