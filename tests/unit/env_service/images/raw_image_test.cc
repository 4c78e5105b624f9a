// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/raw_image.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>
#include <vector>

#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

/// One red pixel and one blue one above each other, with `step` bytes a row.
std::vector<std::uint8_t> pixels(const std::vector<std::uint8_t>& red, const std::vector<std::uint8_t>& blue,
                                 std::size_t step) {
  std::vector<std::uint8_t> data = red;
  data.resize(step);
  data.insert(data.end(), blue.begin(), blue.end());
  data.resize(2 * step);
  return data;
}

TEST(RawImage, EveryEncodingBecomesThePictureThatItIs) {
  const std::vector<std::tuple<std::string, std::vector<std::uint8_t>, std::vector<std::uint8_t>>> cases = {
      {"rgb8", {250, 20, 10}, {10, 20, 250}},
      {"bgr8", {10, 20, 250}, {250, 20, 10}},
      {"rgba8", {250, 20, 10, 0}, {10, 20, 250, 255}},
      {"bgra8", {10, 20, 250, 0}, {250, 20, 10, 255}}};
  for (const auto& [encoding, red, blue] : cases) {
    const auto data = pixels(red, blue, 7);
    Bytes file;
    ASSERT_EQ(encode_raw({1, 2, 7, encoding, data}, file), "") << encoding;
    const cv::Mat picture = decode_image(file, encoding);
    EXPECT_EQ(picture.at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 250)) << encoding;
    EXPECT_EQ(picture.at<cv::Vec3b>(1, 0), cv::Vec3b(250, 20, 10)) << encoding;
  }
  const auto data = pixels({90}, {17}, 1);
  Bytes file;
  ASSERT_EQ(encode_raw({1, 2, 1, "mono8", data}, file), "");
  EXPECT_EQ(decode_image(file, "mono8").at<cv::Vec3b>(1, 0), cv::Vec3b(17, 17, 17));
}

TEST(RawImage, SaysWhatIsWrong) {
  const std::vector<std::uint8_t> data(12);
  Bytes file;
  EXPECT_EQ(encode_raw({2, 2, 6, "yuv422", data}, file),
            "has encoding 'yuv422'; known: rgb8, bgr8, rgba8, bgra8, mono8");
  EXPECT_EQ(encode_raw({2, 3, 6, "rgb8", data}, file), "has fewer bytes than its size says");
  EXPECT_EQ(encode_raw({2, 2, 5, "rgb8", data}, file), "has fewer bytes than its size says");
  EXPECT_EQ(encode_raw({0, 2, 6, "rgb8", data}, file), "has 0 x 2 pixels");
  EXPECT_EQ(encode_raw({1u << 31, 1u << 31, 1u << 31, "mono8", data}, file), "has 2147483648 x 2147483648 pixels");
}

}  // namespace
}  // namespace citylearn
