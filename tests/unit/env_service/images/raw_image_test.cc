// SPDX-License-Identifier: Apache-2.0
#include "env_service/images/raw_image.h"

#include <gtest/gtest.h>

#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <tuple>
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

cv::Mat picture_of(const RawImage& image) {
  Bytes file;
  EXPECT_EQ(encode_raw(image, file), "") << image.encoding;
  return decode_image(file, image.encoding);
}

TEST(RawImage, EveryEncodingBecomesThePictureThatItIs) {
  const std::vector<std::tuple<std::string, std::vector<std::uint8_t>, std::vector<std::uint8_t>>> cases = {
      {"rgb8", {250, 20, 10}, {10, 20, 250}},          {"bgr8", {10, 20, 250}, {250, 20, 10}},
      {"8UC3", {10, 20, 250}, {250, 20, 10}},          {"rgba8", {250, 20, 10, 0}, {10, 20, 250, 255}},
      {"bgra8", {10, 20, 250, 0}, {250, 20, 10, 255}}, {"8UC4", {10, 20, 250, 0}, {250, 20, 10, 255}}};
  for (const auto& [encoding, red, blue] : cases) {
    const auto data = pixels(red, blue, 7);
    Bytes file;
    ASSERT_EQ(encode_raw({1, 2, 7, encoding, data}, file), "") << encoding;
    const cv::Mat picture = decode_image(file, encoding);
    EXPECT_EQ(picture.at<cv::Vec3b>(0, 0), cv::Vec3b(10, 20, 250)) << encoding;
    EXPECT_EQ(picture.at<cv::Vec3b>(1, 0), cv::Vec3b(250, 20, 10)) << encoding;
  }
  const auto data = pixels({90}, {17}, 1);
  for (const char* encoding : {"mono8", "8UC1"})
    EXPECT_EQ(picture_of({1, 2, 1, encoding, data}).at<cv::Vec3b>(1, 0), cv::Vec3b(17, 17, 17)) << encoding;
}

TEST(RawImage, NumbersOf16BitsInEitherByteOrder) {
  // 0x3412, 0x7856 and 0xBC9A from little bytes; of each the high byte is kept.
  const std::vector<std::uint8_t> data = {0x12, 0x34, 0x56, 0x78, 0x9A, 0xBC, 0xFF, 0xFF};
  const cv::Vec3b little(0xBC, 0x78, 0x34), big(0x9A, 0x56, 0x12);  // as BGR, of rgb16
  EXPECT_EQ(picture_of({1, 1, 8, "rgb16", data}).at<cv::Vec3b>(0, 0), little);
  EXPECT_EQ(picture_of({1, 1, 8, "rgb16", data, true}).at<cv::Vec3b>(0, 0), big);
  EXPECT_EQ(picture_of({1, 1, 8, "bgra16", data}).at<cv::Vec3b>(0, 0), cv::Vec3b(0x34, 0x78, 0xBC));
  for (const char* encoding : {"bgr16", "16UC3"})
    EXPECT_EQ(picture_of({1, 1, 8, encoding, data}).at<cv::Vec3b>(0, 0), cv::Vec3b(0x34, 0x78, 0xBC)) << encoding;
  for (const char* encoding : {"mono16", "16UC1"})
    EXPECT_EQ(picture_of({2, 2, 4, encoding, data}).at<cv::Vec3b>(1, 0), cv::Vec3b(0xBC, 0xBC, 0xBC)) << encoding;
}

/// A sensor of 4 x 4 pixels that sees one plain colour: `lit` says which letters of the mosaic have light.
std::vector<std::uint8_t> mosaic_of(const std::string& pattern, char lit, std::size_t depth, std::size_t step) {
  std::vector<std::uint8_t> data(4 * step);
  for (std::size_t y = 0; y < 4; ++y)
    for (std::size_t x = 0; x < 4; ++x)
      if (pattern[2 * (y % 2) + x % 2] == lit) data[y * step + depth * x + depth - 1] = 200;
  return data;
}

TEST(RawImage, AMosaicOfAPlainColourIsThatColour) {
  const std::map<char, cv::Vec3b> colours = {{'r', {0, 0, 200}}, {'g', {0, 200, 0}}, {'b', {200, 0, 0}}};
  for (const std::string pattern : {"rggb", "bggr", "gbrg", "grbg"})
    for (const auto& [lit, colour] : colours) {
      const cv::Mat plain(4, 4, CV_8UC3, cv::Scalar(colour));
      const auto eight = mosaic_of(pattern, lit, 1, 6), sixteen = mosaic_of(pattern, lit, 2, 9);
      const cv::Mat picture = picture_of({4, 4, 6, "bayer_" + pattern + "8", eight});
      EXPECT_EQ(cv::norm(picture, plain, cv::NORM_INF), 0) << pattern << lit << picture;
      EXPECT_EQ(cv::norm(picture_of({4, 4, 9, "bayer_" + pattern + "16", sixteen}), plain, cv::NORM_INF), 0) << pattern;
    }
}

TEST(RawImage, YuvIsThatOfBt601) {
  // BT.601, 16 to 235: red is Y 81, U 90, V 240: R 1.164 65 + 1.596 112 = 254, G and B 0.
  const std::uint8_t y = 81, u = 90, v = 240;
  const std::vector<std::uint8_t> uyvy = {u, y, v, y, 0, u, y, v, y, 0}, yuyv = {y, u, y, v, 0, y, u, y, v, 0};
  const std::vector<std::uint8_t> nv12 = {y, y, 0, y, y, 0, u, v, 0}, nv21 = {y, y, 0, y, y, 0, v, u, 0};
  const cv::Mat red(2, 2, CV_8UC3, cv::Scalar(0, 0, 254));
  for (const auto& [encoding, step, data] :
       std::vector<std::tuple<std::string, unsigned, std::vector<std::uint8_t>>>{{"yuv422", 5, uyvy},
                                                                                 {"uyvy", 5, uyvy},
                                                                                 {"yuv422_yuy2", 5, yuyv},
                                                                                 {"yuyv", 5, yuyv},
                                                                                 {"nv12", 3, nv12},
                                                                                 {"nv21", 3, nv21}}) {
    const cv::Mat picture = picture_of({2, 2, step, encoding, data});
    EXPECT_LE(cv::norm(picture, red, cv::NORM_INF), 1) << encoding << picture;
  }
}

TEST(RawImage, SaysWhatIsWrong) {
  const std::vector<std::uint8_t> data(12);
  Bytes file;
  EXPECT_EQ(encode_raw({2, 2, 6, "32FC1\n", data}, file),
            "has encoding '32FC1 '; known: 8UC1, 8UC3, 8UC4, bayer_bggr8, bayer_gbrg8, bayer_grbg8, bayer_rggb8, "
            "bgr8, bgra8, mono8, nv12, nv21, rgb8, rgba8, uyvy, yuv422, yuv422_yuy2, yuyv; of 8 bits the same with 16");
  for (const char* encoding : {"", " ", "mono", "8UC2", "rgb8 ", "bayer_rggb12", "yuv416", "mono8 8UC1"})
    EXPECT_TRUE(encode_raw({2, 2, 6, encoding, data}, file).starts_with("has encoding '")) << encoding;
  EXPECT_EQ(encode_raw({2, 3, 6, "rgb8", data}, file), "has 12 bytes, 6 a row; 3 rows of at least 6 are wanted");
  EXPECT_EQ(encode_raw({2, 2, 5, "rgb8", data}, file), "has 12 bytes, 5 a row; 2 rows of at least 6 are wanted");
  EXPECT_EQ(encode_raw({2, 1, 6, "rgb8", data}, file), "has 12 bytes, 6 a row; 1 rows of at least 6 are wanted");
  EXPECT_EQ(encode_raw({2, 2, 6, "nv12", data}, file), "has 12 bytes, 6 a row; 3 rows of at least 2 are wanted");
  EXPECT_EQ(encode_raw({2, 2, 0, "mono8", {}}, file), "has 0 bytes, 0 a row; 2 rows of at least 2 are wanted");
  EXPECT_EQ(encode_raw({2, 2, 6, "bayer_rggb8", data}, file), "has 2 x 2 pixels of bayer_rggb8");
  EXPECT_EQ(encode_raw({3, 2, 6, "yuv422", data}, file), "has 3 x 2 pixels of yuv422");
  EXPECT_EQ(encode_raw({2, 3, 4, "nv21", data}, file), "has 2 x 3 pixels of nv21");
  EXPECT_EQ(encode_raw({1 << 17, 1, 1 << 17, "mono8", data}, file), "has 131072 x 1 pixels of mono8");
  EXPECT_EQ(encode_raw({0, 2, 6, "rgb8", data}, file), "has 0 x 2 pixels of rgb8");
  EXPECT_EQ(encode_raw({1u << 31, 1u << 31, 1u << 31, "mono8", data}, file),
            "has 2147483648 x 2147483648 pixels of mono8");
}

}  // namespace
}  // namespace citylearn
