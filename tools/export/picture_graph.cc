// SPDX-License-Identifier: Apache-2.0
#include "tools/export/picture_graph.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace citylearn {
namespace {

using RowMajor = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Matrix<float> matrix_of(const cv::Mat& rows) {
  return Eigen::Map<const RowMajor>(rows.ptr<float>(), rows.rows, rows.cols);
}

/// Returns the weights (to x from) by which OpenCV resizes a line of pixels.
Matrix<float> resizing_weights(int from, int to, int interpolation) {
  cv::Mat weights;
  cv::resize(cv::Mat::eye(from, from, CV_32F), weights, {from, to}, 0, 0, interpolation);
  return matrix_of(weights);
}

/// Returns the weights by which cv::GaussianBlur smooths a line of floats, with its kernel's size and its borders.
Matrix<float> smoothing_weights(int length, double sigma) {
  const int size = cvRound(sigma * 8 + 1) | 1;
  cv::Mat weights;
  cv::sepFilter2D(cv::Mat::eye(length, length, CV_32F), weights, CV_32F, cv::Mat::ones(1, 1, CV_32F),
                  cv::getGaussianKernel(size, sigma, CV_32F));
  return matrix_of(weights);
}

/// Multiplies each row of pixels by `weights`, and turns the picture by its diagonal.
OnnxPicture multiplied_and_turned(const OnnxPicture& picture, const Matrix<float>& weights) {
  OnnxGraph& graph = *picture.value.graph;
  const std::int64_t width = weights.rows(), height = picture.height;
  OnnxValue lines = graph.node("Reshape", {picture.value, graph.integers({-1, picture.width})});
  lines = graph.linear(lines, "encoder.lines", weights);
  lines = graph.node("Reshape", {lines, graph.integers({-1, picture.channels, height, width})});
  return {graph.node("Transpose", {lines}, {{"perm", std::vector<std::int64_t>{0, 1, 3, 2}}}), picture.channels,
          picture.height, static_cast<int>(width)};
}

}  // namespace

OnnxPicture transformed(const OnnxPicture& picture, const Matrix<float>& across, const Matrix<float>& down) {
  return multiplied_and_turned(multiplied_and_turned(picture, across), down);
}

OnnxPicture resized(const OnnxPicture& picture, int width, int height, int interpolation) {
  if (width == picture.width && height == picture.height) return picture;
  return transformed(picture, resizing_weights(picture.width, width, interpolation),
                     resizing_weights(picture.height, height, interpolation));
}

OnnxPicture recoloured(const OnnxPicture& picture, const Matrix<float>& weights, const std::vector<float>& bias) {
  OnnxGraph& graph = *picture.value.graph;
  const RowMajor rows = weights;
  const OnnxValue kernel =
      graph.constant("encoder.colours", {rows.rows(), rows.cols(), 1, 1}, {rows.data(), rows.data() + rows.size()});
  return {graph.node("Conv", {picture.value, kernel, graph.constant("encoder.offsets", {rows.rows()}, bias)},
                     {{"kernel_shape", std::vector<std::int64_t>{1, 1}}}),
          static_cast<int>(rows.rows()), picture.width, picture.height};
}

OnnxPicture rounded(const OnnxPicture& picture) {
  OnnxPicture result = picture;
  result.value = picture.value.graph->node("Floor", {picture.value + 0.5f});
  return result;
}

OnnxPicture limited(const OnnxPicture& picture, float most) {
  OnnxPicture result = picture;
  result.value = -1 * relu(-1 * relu(picture.value) + most) + most;
  return result;
}

OnnxPicture scaled(const OnnxPicture& picture, int width, int height, bool bytes) {
  const auto step = [&](const OnnxPicture& from, int w, int h, int interpolation) {
    if (from.width == w && from.height == h) return from;
    const OnnxPicture to = resized(from, w, h, interpolation);
    return bytes ? limited(rounded(to), 255) : to;
  };
  return step(step(picture, std::min(picture.width, width), std::min(picture.height, height), cv::INTER_AREA), width,
              height, cv::INTER_CUBIC);
}

OnnxPicture scaled_grey(const OnnxPicture& picture, int width, int height) {
  Matrix<float> weights(1, 3);  // OpenCV's, of 2^15, so that grey values are the same whole numbers
  weights << 9798, 19235, 3735;
  weights /= 32768;
  return limited(scaled(rounded(recoloured(picture, weights, {0})), width, height, false), 255);
}

OnnxPicture sliding_normalised(const OnnxPicture& picture, double sigma) {
  const Matrix<float> across = smoothing_weights(picture.width, sigma), down = smoothing_weights(picture.height, sigma);
  const auto smoothed = [&](const OnnxValue& value) {
    OnnxPicture one = picture;
    one.value = value;
    return transformed(one, across, down).value;
  };
  const OnnxValue shifted = picture.value + -128, mean = smoothed(shifted);
  const OnnxValue variance = relu(smoothed(shifted * shifted) - mean * mean) + 16;
  OnnxPicture result = picture;
  result.value = (shifted - mean) * exp(-0.5f * log(variance));
  return result;
}

OnnxValue flattened(const OnnxPicture& picture, bool channels_last) {
  OnnxGraph& graph = *picture.value.graph;
  OnnxValue value = picture.value;
  if (channels_last && picture.channels > 1)
    value = graph.node("Transpose", {value}, {{"perm", std::vector<std::int64_t>{0, 2, 3, 1}}});
  return graph.node("Reshape",
                    {value, graph.integers({-1, std::int64_t{picture.channels} * picture.height * picture.width})});
}

}  // namespace citylearn
