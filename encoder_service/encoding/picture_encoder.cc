// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/picture_encoder.h"

#include <algorithm>
#include <cstdio>
#include <opencv2/imgproc.hpp>

namespace citylearn {

void check_picture(const cv::Mat& picture) {
  if (picture.empty()) throw Error("an empty picture");
  if (picture.type() != CV_8UC3)
    throw Error("a picture of OpenCV type " + std::to_string(picture.type()), "", "give 8 bits, 3 channels, BGR");
}

Eigen::MatrixXf PictureEncoder::encode(std::span<const cv::Mat> pictures) {
  Eigen::MatrixXf descriptors = Eigen::MatrixXf::Zero(spec().dimension, static_cast<Eigen::Index>(pictures.size()));
  Eigen::Index column = 0;
  for (const cv::Mat& picture : pictures) {
    check_picture(picture);
    try {
      describe(picture, descriptors.col(column));
    } catch (const cv::Exception& exception) {
      throw Error("OpenCV: " + exception.err, spec().name);
    }
    if (!descriptors.col(column).allFinite()) throw Error("a descriptor that is not finite", spec().name);
    ++column;
  }
  return descriptors;
}

std::string encoder_name(const std::string& name_and_version, const Parameters& parameters) {
  std::string name = name_and_version;
  for (const auto& [parameter, value] : parameters.values()) {
    char text[32];
    std::snprintf(text, sizeof text, "%.9g", value);
    name += " " + parameter + "=" + text;
  }
  return name;
}

cv::Mat scaled(const cv::Mat& picture, int width, int height) {
  cv::Mat result = picture;
  const cv::Size smaller(std::min(picture.cols, width), std::min(picture.rows, height));
  if (result.size() != smaller) cv::resize(picture, result, smaller, 0, 0, cv::INTER_AREA);
  if (smaller == cv::Size(width, height)) return result;
  cv::Mat larger;
  cv::resize(result, larger, {width, height}, 0, 0, cv::INTER_CUBIC);
  return larger;
}

cv::Mat scaled_grey(const cv::Mat& picture, int width, int height) {
  cv::Mat grey, real;
  cv::cvtColor(picture, grey, cv::COLOR_BGR2GRAY);
  grey.convertTo(real, CV_32F);
  real = scaled(real, width, height);
  // Cubic interpolation overshoots at edges.
  return cv::min(cv::max(real, 0.f), 255.f);
}

cv::Mat sliding_normalised(const cv::Mat& picture, double sigma) {
  // Variance as mean of squares minus square of mean loses few digits when the values are taken about a middle.
  const cv::Mat shifted = picture - cv::Scalar::all(128);
  cv::Mat mean, squares;
  cv::GaussianBlur(shifted, mean, {}, sigma);
  cv::GaussianBlur(shifted.mul(shifted), squares, {}, sigma);
  cv::Mat deviation = cv::max(squares - mean.mul(mean), 0.f) + cv::Scalar::all(16);
  cv::sqrt(deviation, deviation);
  return (shifted - mean) / deviation;
}

}  // namespace citylearn
