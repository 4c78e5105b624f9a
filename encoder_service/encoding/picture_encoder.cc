// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/encoding/picture_encoder.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <opencv2/core/utility.hpp>
#include <opencv2/imgproc.hpp>

#include "encoder_service/encoding/area_means.h"

namespace citylearn {

void check_picture(const cv::Mat& picture) {
  if (picture.empty()) throw Error("an empty picture");
  if (picture.type() != CV_8UC3)
    throw Error("a picture of OpenCV type " + std::to_string(picture.type()), "", "give 8 bits, 3 channels, BGR");
}

Eigen::MatrixXf PictureEncoder::encode(std::span<const cv::Mat> pictures) {
  const Spec spec = this->spec();
  for (const cv::Mat& picture : pictures) check_picture(picture);
  Eigen::MatrixXf descriptors = Eigen::MatrixXf::Zero(spec.dimension, static_cast<Eigen::Index>(pictures.size()));
  for_each_on_threads(static_cast<int>(pictures.size()), [&](int i) {
    try {
      describe(pictures[static_cast<std::size_t>(i)], descriptors.col(i));
    } catch (const cv::Exception& exception) {
      throw Error("OpenCV: " + exception.err, spec.name);
    }
    if (!descriptors.col(i).allFinite()) throw Error("a descriptor that is not finite", spec.name);
  });
  return descriptors;
}

int PictureEncoder::batch() { return std::max(16, 2 * cv::getNumThreads()); }

void for_each_on_threads(int count, const std::function<void(int)>& work) {
  cv::parallel_for_({0, count}, [&](const cv::Range& range) {
    for (int i = range.start; i < range.end; ++i) work(i);
  });
}

std::string encoder_name(const std::string& name_and_version, const Parameters& parameters) {
  std::string name = name_and_version;
  for (const auto& [parameter, value] : parameters.values()) name += fmt::format(" {}={:.9g}", parameter, value);
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
  const cv::Size size(width, height);
  if (grey.size() != size && width <= grey.cols && height <= grey.rows) return area_means(grey, size);
  grey.convertTo(real, CV_32F);
  real = scaled(real, width, height);
  // Cubic interpolation overshoots at edges.
  return cv::min(cv::max(real, 0.f), 255.f);
}

}  // namespace citylearn
