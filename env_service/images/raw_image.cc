// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/raw_image.h"

#include <map>
#include <opencv2/imgproc.hpp>

#include "core/files/image_header.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

struct Encoding {
  int channels;
  int to_bgr;  ///< OpenCV's code; -1: it is so already
};
const std::map<std::string, Encoding> kEncodings = {{"mono8", {1, -1}},
                                                    {"bgr8", {3, -1}},
                                                    {"rgb8", {3, cv::COLOR_RGB2BGR}},
                                                    {"bgra8", {4, cv::COLOR_BGRA2BGR}},
                                                    {"rgba8", {4, cv::COLOR_RGBA2BGR}}};

}  // namespace

std::string encode_raw(const RawImage& image, Bytes& file) {
  const auto found = kEncodings.find(image.encoding);
  if (found == kEncodings.end()) return "has encoding '" + image.encoding + "'; known: rgb8, bgr8, rgba8, bgra8, mono8";
  const auto [channels, to_bgr] = found->second;
  const std::uint64_t pixels = std::uint64_t{image.width} * image.height;
  if (pixels == 0 || pixels > static_cast<std::uint64_t>(kMaxPixels))
    return "has " + std::to_string(image.width) + " x " + std::to_string(image.height) + " pixels";
  if (image.step < std::uint64_t{image.width} * static_cast<std::uint64_t>(channels) ||
      image.data.size() < std::uint64_t{image.step} * image.height)
    return "has fewer bytes than its size says";
  auto* const data = const_cast<std::uint8_t*>(image.data.data());  // NOLINT: it is only read
  const cv::Mat given(static_cast<int>(image.height), static_cast<int>(image.width), CV_8UC(channels), data,
                      image.step);
  cv::Mat picture = given;
  if (to_bgr >= 0) cv::cvtColor(given, picture, to_bgr);
  encode_png(picture, file);
  return "";
}

}  // namespace citylearn
