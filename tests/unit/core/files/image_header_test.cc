// SPDX-License-Identifier: Apache-2.0
#include "core/files/image_header.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string_view>
#include <tuple>

#include "core/util/error.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using namespace std::string_literals;
using namespace std::string_view_literals;

std::span<const std::byte> as_byte_span(std::string_view text) { return std::as_bytes(std::span(text)); }

std::string image_file(const std::string& suffix, int width, int height, int channels = 3) {
  cv::Mat picture(height, width, CV_8UC(channels));
  cv::randu(picture, 0, 256);
  std::vector<unsigned char> file;
  cv::imencode(suffix, picture, file);
  return {file.begin(), file.end()};
}

ImageHeader image_header_of(std::string_view file) { return read_image_header(as_byte_span(file), "here.png"); }

/// Returns the fault of a file; empty when it is read without one.
std::string fault_of(std::string_view file) {
  return error_of([&] { image_header_of(file); });
}

std::string big32(std::uint32_t number) {
  std::string text;
  for (int shift = 24; shift >= 0; shift -= 8) text += static_cast<char>(number >> shift & 255);
  return text;
}
std::string little32(std::uint32_t number) {
  std::string text = big32(number);
  std::reverse(text.begin(), text.end());
  return text;
}
std::string png(std::uint32_t width, std::uint32_t height) {
  return "\x89PNG\r\n\x1A\n\0\0\0\rIHDR"s + big32(width) + big32(height) + "\x08\x02\0\0\0"s;
}
std::string bmp(std::uint32_t header_size, std::uint32_t width, std::uint32_t height) {
  return "BM" + std::string(12, '\0') + little32(header_size) + little32(width) + little32(height);
}
std::string segment(char marker, std::string_view body) {
  const std::size_t size = body.size() + 2;
  return std::string("\xFF") + marker + static_cast<char>(size >> 8) + static_cast<char>(size & 255) +
         std::string(body);
}
const std::string kFrame = segment('\xC0', "\x08\x00\x30\x00\x40\x03"sv);  // 64 x 48

class Written : public ::testing::TestWithParam<std::tuple<const char*, const char*, int>> {};

TEST_P(Written, IsReadAsOpenCvWroteIt) {
  const auto& [suffix, format, channels] = GetParam();
  for (const auto& [width, height] : {std::pair{1, 1}, {640, 480}, {31, 257}, {2000, 3}}) {
    const std::string file = image_file(suffix, width, height, channels);
    const ImageHeader header = image_header_of(file);
    EXPECT_EQ(header.format, format);
    EXPECT_EQ(header.width, width);
    EXPECT_EQ(header.height, height);
    EXPECT_EQ(image_fault(as_byte_span(file)), std::nullopt);
    // Its first 64 KiB are enough.
    EXPECT_EQ(image_header_of(std::string_view(file).substr(0, 1 << 16)).height, height);
  }
}

INSTANTIATE_TEST_SUITE_P(ImageHeader, Written,
                         ::testing::Values(std::tuple{".jpg", "jpeg", 3}, std::tuple{".jpg", "jpeg", 1},
                                           std::tuple{".png", "png", 3}, std::tuple{".png", "png", 1},
                                           std::tuple{".bmp", "bmp", 3}, std::tuple{".ppm", "pnm", 3},
                                           std::tuple{".pgm", "pnm", 1}));

TEST(ImageHeader, FindsAJpegsSizeBehindOtherSegments) {
  const std::string thumbnail = segment('\xE1', "\xFF\xD8\xFF\xC0\x00\x11\x08\x00\x01\x00\x01\xFF\xD9"sv);
  const std::string large = segment('\xE2', std::string(65000, 'x'));
  ImageHeader header = image_header_of("\xFF\xD8" + thumbnail + large + large + "\xFF\xFF" + kFrame);
  EXPECT_EQ(header.width, 64);
  EXPECT_EQ(header.height, 48);
  // Huffman tables and arithmetic conditioning have markers between those of frames; progressive is a frame.
  header = image_header_of("\xFF\xD8" + segment('\xC4', "table") + segment('\xCC', "table") +
                           segment('\xC2', "\x08\x00\x05\x00\x06"sv));
  EXPECT_EQ(header.width, 6);
  EXPECT_EQ(header.height, 5);
}

TEST(ImageHeader, RefusesBrokenJpegs) {
  EXPECT_EQ(fault_of("\xFF\xD8\xFF"), "here.png: the image file is cut short in its header");
  EXPECT_EQ(fault_of("\xFF\xD8\xFF\xE0\x7F\xFFJFIF"), "here.png: the image file is cut short in its header");
  EXPECT_EQ(fault_of("\xFF\xD8\xFF\xE0\x00\x01xx"sv), "here.png: a broken JPEG header");
  EXPECT_EQ(fault_of("\xFF\xD8\xFF\xE0\x00\x02xx"sv), "here.png: a broken JPEG header");
  EXPECT_EQ(fault_of("\xFF\xD8\xFF\xDA\x00\x02"sv), "here.png: a JPEG file that tells no size before its data");
  EXPECT_EQ(fault_of("\xFF\xD8\xFF\xD9"), "here.png: a JPEG file that tells no size before its data");
  EXPECT_EQ(fault_of("\xFF\xD8" + segment('\xC0', "\x08\x00\x00\x00\x40\x03"sv)),
            "here.png: an image of 64 x 0 pixels");
}

TEST(ImageHeader, ReadsPnmAsPeopleWriteIt) {
  const ImageHeader header = image_header_of("P5 # a comment\n#another\n \t12\r\n#last\n 34 255\n...");
  EXPECT_EQ(header.width, 12);
  EXPECT_EQ(header.height, 34);
  EXPECT_EQ(image_header_of("P1\n2 3\n0 1").format, "pnm");
}

TEST(ImageHeader, RefusesBrokenPnms) {
  EXPECT_EQ(fault_of("P5#12 34 255\n"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of("P512 34 255\n"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of("P5"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of("P5 12"), "here.png: the image file is cut short in its header");
  EXPECT_EQ(fault_of("P5 # no end"), "here.png: the image file is cut short in its header");
  EXPECT_EQ(fault_of("P5 12 x"), "here.png: a broken PNM header");
  EXPECT_EQ(fault_of("P5 -12 3 255\n"), "here.png: a broken PNM header");
  EXPECT_EQ(fault_of("P5 99999999999999999999999 3 255\n"), "here.png: a broken PNM header");
  EXPECT_EQ(fault_of("P7\nWIDTH 3\n"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
}

TEST(ImageHeader, ABmpMayBeStoredFromTheTop) {
  EXPECT_EQ(image_header_of(bmp(40, 8, static_cast<std::uint32_t>(-6))).height, 6);
  EXPECT_EQ(image_header_of(bmp(124, 8, 6)).height, 6);
  EXPECT_EQ(fault_of(bmp(12, 8, 6)), "here.png: a BMP file older than Windows 3");
  EXPECT_EQ(fault_of(bmp(40, static_cast<std::uint32_t>(-8), 6)), "here.png: an image of -8 x 6 pixels");
  EXPECT_EQ(fault_of(bmp(40, 8, 0x80000000)),
            "here.png: an image of 8 x 2147483648 pixels, at most 67108864 are allowed");
}

TEST(ImageHeader, RefusesSizesByTheHeaderAlone) {
  EXPECT_EQ(image_header_of(png(8192, 8192)).width, 8192);
  EXPECT_EQ(fault_of(png(8192, 8193)), "here.png: an image of 8192 x 8193 pixels, at most 67108864 are allowed");
  EXPECT_EQ(fault_of(png(0xFFFFFFFF, 0xFFFFFFFF)),
            "here.png: an image of 4294967295 x 4294967295 pixels, at most 67108864 are allowed");
  EXPECT_EQ(fault_of(png(67108865, 1)), "here.png: an image of 67108865 x 1 pixels, at most 67108864 are allowed");
  EXPECT_EQ(fault_of(png(0, 5)), "here.png: an image of 0 x 5 pixels");
  EXPECT_EQ(fault_of(png(5, 0)), "here.png: an image of 5 x 0 pixels");
  EXPECT_EQ(fault_of("P5 4294967295 4294967295 255\n"),
            "here.png: an image of 4294967295 x 4294967295 pixels, at most 67108864 are allowed");
}

TEST(ImageHeader, RefusesOtherFiles) {
  EXPECT_EQ(fault_of(""), "here.png: an empty file");
  EXPECT_EQ(fault_of("GIF89a......"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of("P"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of("\x89PNG"), "here.png: neither a JPEG, PNG, PNM nor BMP file");
  EXPECT_EQ(fault_of(png(5, 6).substr(0, 23)), "here.png: the image file is cut short in its header");
}

TEST(ImageHeader, EachCutHeaderIsAnError) {
  for (const char* suffix : {".jpg", ".png", ".bmp", ".ppm"}) {
    const std::string file = image_file(suffix, 40, 30);
    bool whole = false;
    for (std::size_t size = 0; size < std::min<std::size_t>(file.size(), 1000); ++size) {
      // In a buffer of its own, so that a sanitizer sees a read beyond it.
      const std::vector<char> head(file.begin(), file.begin() + static_cast<std::ptrdiff_t>(size));
      const bool read = fault_of({head.data(), head.size()}).empty();
      EXPECT_TRUE(read || !whole) << suffix << " of " << size << " bytes";
      whole = read;
    }
    EXPECT_TRUE(whole);
  }
}

TEST(ImageFault, TellsFilesThatAreCut) {
  for (const char* suffix : {".jpg", ".png"}) {
    std::string file = image_file(suffix, 200, 100);
    for (const std::size_t left : {file.size() / 2, file.size() - 12, std::size_t{30}})
      EXPECT_TRUE(image_fault(as_byte_span(file.substr(0, left)))) << suffix << " of " << left << " bytes";
    EXPECT_EQ(image_fault(as_byte_span(file)), std::nullopt);
  }
  EXPECT_EQ(image_fault(as_byte_span("")), "an empty file");
  EXPECT_EQ(image_fault(as_byte_span("text")), "neither a JPEG, PNG, PNM nor BMP file");
}

TEST(ImageFault, CamerasPadJpegs) {
  std::string file = image_file(".jpg", 200, 100);
  EXPECT_EQ(image_fault(as_byte_span(file + std::string(4000, '\0'))), std::nullopt);
  EXPECT_TRUE(image_fault(as_byte_span(file + std::string(5000, '\0'))));
}

}  // namespace
}  // namespace citylearn::testing
