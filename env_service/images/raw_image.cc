// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/raw_image.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>

#include "core/files/image_header.h"
#include "core/util/text.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr std::uint32_t kMaxSide = 1 << 16;

struct Encoding {
  int channels;
  int to_bgr;  ///< OpenCV's code; -1: it is so already
};
/// The encodings of 8 bits. ROS names a mosaic by its first two rows, OpenCV by the second and third pixel of the
/// second one: bayer_rggb8 is OpenCV's BayerBG.
const std::map<std::string, Encoding> kEncodings = {{"mono8", {1, -1}},
                                                    {"8UC1", {1, -1}},
                                                    {"bgr8", {3, -1}},
                                                    {"8UC3", {3, -1}},
                                                    {"rgb8", {3, cv::COLOR_RGB2BGR}},
                                                    {"bgra8", {4, cv::COLOR_BGRA2BGR}},
                                                    {"8UC4", {4, cv::COLOR_BGRA2BGR}},
                                                    {"rgba8", {4, cv::COLOR_RGBA2BGR}},
                                                    {"bayer_rggb8", {1, cv::COLOR_BayerBG2BGR}},
                                                    {"bayer_bggr8", {1, cv::COLOR_BayerRG2BGR}},
                                                    {"bayer_gbrg8", {1, cv::COLOR_BayerGR2BGR}},
                                                    {"bayer_grbg8", {1, cv::COLOR_BayerGB2BGR}},
                                                    {"yuv422", {2, cv::COLOR_YUV2BGR_UYVY}},
                                                    {"uyvy", {2, cv::COLOR_YUV2BGR_UYVY}},
                                                    {"yuv422_yuy2", {2, cv::COLOR_YUV2BGR_YUYV}},
                                                    {"yuyv", {2, cv::COLOR_YUV2BGR_YUYV}},
                                                    {"nv12", {1, cv::COLOR_YUV2BGR_NV12}},
                                                    {"nv21", {1, cv::COLOR_YUV2BGR_NV21}}};

/// The encoding that has 8 bits where `name` has 16.
std::string of_8_bits(std::string name) {
  if (name.starts_with("16U")) name.replace(0, 2, "8");
  if (name.ends_with("16")) name.replace(name.size() - 2, 2, "8");
  return name;
}

std::uint64_t rows_of(const RawImage& image, const std::string& name) {
  return std::uint64_t{image.height} + (name.starts_with("nv") ? image.height / 2 : 0);  // colours stand below
}

}  // namespace

std::string raw_fault(const RawImage& image) {
  const std::string name = of_8_bits(image.encoding);
  const auto found = kEncodings.find(name);
  if (found == kEncodings.end())
    return "has encoding '" + one_line(image.encoding.substr(0, 40)) +
           "'; known: " + joined(kEncodings, [](const auto& known) { return known.first; }) +
           "; of 8 bits the same with 16";
  const bool planes = name.starts_with("nv");
  const auto [least, most] = std::minmax(image.width, image.height);
  if (least < (name.starts_with("bayer") ? 3 : 1) || most > kMaxSide || std::uint64_t{least} * most > kMaxPixels ||
      ((planes || found->second.channels == 2) && image.width % 2 != 0) || (planes && image.height % 2 != 0))
    return fmt::format("has {} x {} pixels of {}", image.width, image.height, image.encoding);
  const std::uint64_t row = std::uint64_t{image.width} * found->second.channels * (name == image.encoding ? 1 : 2),
                      rows = rows_of(image, name);
  if (image.step < row || image.data.size() != image.step * rows)
    return fmt::format("has {} bytes, {} a row; {} rows of at least {} are wanted", image.data.size(), image.step, rows,
                       row);
  return "";
}

std::string encode_raw(const RawImage& image, Bytes& file) {
  if (const std::string fault = raw_fault(image); !fault.empty()) return fault;
  const std::string name = of_8_bits(image.encoding);
  const auto [pixel, to_bgr] = kEncodings.at(name);  // pixel: its channels
  const int depth = name == image.encoding ? 1 : 2;
  auto* const data = const_cast<std::uint8_t*>(image.data.data());  // NOLINT: it is only read
  cv::Mat given(static_cast<int>(rows_of(image, name)), static_cast<int>(image.width), CV_8UC(pixel * depth), data,
                image.step);
  if (depth == 2) {
    cv::extractChannel(cv::Mat(given.reshape(2)), given, image.is_bigendian ? 0 : 1);  // the high bytes
    given = given.reshape(pixel);
  }
  cv::Mat picture = given;
  if (to_bgr >= 0) cv::cvtColor(given, picture, to_bgr);
  encode_png(picture, file);
  return "";
}

}  // namespace citylearn
