// SPDX-License-Identifier: Apache-2.0
// Pictures that say how they are to be turned, and JPEG files of which a part is missing.
#include <gtest/gtest.h>

#include <set>

#include "core/files/image_header.h"
#include "env_service/images/image_sources.h"
#include "tests/support/data/pictures.h"
#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Corners = std::array<int, 4>;  // brightness: upper left, upper right, lower left, lower right

cv::Mat drawn(const Corners& corners, const cv::Size& size) {
  cv::Mat picture(size, CV_8UC3);
  const cv::Size half = size / 2;
  for (int i = 0; i < 4; ++i)
    picture(cv::Rect({i % 2 * half.width, i / 2 * half.height}, half)) =
        cv::Scalar::all(corners[static_cast<std::size_t>(i)]);
  return picture;
}

std::string big(unsigned value, int bytes) {
  std::string text;
  while (bytes-- > 0) text += static_cast<char>(value >> (8 * bytes));
  return text;
}

/// EXIF data whose second field is the orientation, as a SHORT of either byte order.
std::string exif(int orientation, bool little) {
  const std::string head = little ? std::string("II*\0\x8\0\0\0\x2\0", 10) : std::string("MM\0*\0\0\0\x8\0\x2", 10);
  const std::string make =
      little ? std::string("\x0F\1\2\0\2\0\0\0a\0\0\0", 12) : std::string("\1\x0F\0\2\0\0\0\2a\0\0\0", 12);
  const char o = static_cast<char>(orientation);
  const std::string field = little ? std::string("\x12\1\3\0\1\0\0\0", 8) + o + std::string(3, '\0')
                                   : std::string("\1\x12\0\3\0\0\0\1\0", 9) + o + std::string(2, '\0');
  return head + make + field + std::string(4, '\0');
}

std::string png_chunk(const std::string& text) {
  unsigned crc = ~0u;
  for (const char c : text) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xEDB88320u : 0);
  }
  return big(static_cast<unsigned>(text.size()) - 4, 4) + text + big(~crc, 4);
}

Corners seen(Images& images, cv::Size& size) {
  Bytes bytes;
  images.read(0, bytes);
  const ImageHeader header = read_image_header(bytes, "");
  size = {header.width, header.height};
  const cv::Mat picture = decode_image(bytes, "x");
  Corners corners;
  for (int i = 0; i < 4; ++i)
    corners[static_cast<std::size_t>(i)] =
        picture.at<cv::Vec3b>((1 + 2 * (i / 2)) * picture.rows / 4, (1 + 2 * (i % 2)) * picture.cols / 4)[0];
  return corners;
}

/// The place of the first stored row and column (CIPA DC-008, 4.6.4): 1 top left, 2 top right, 3 bottom right, 4 bottom
/// left, 5 left top, 6 right top, 7 right bottom, 8 left bottom.
TEST(Orientation, AllEightAreTurnedOnce) {
  const Corners upright{40, 100, 160, 220};
  const std::vector<Corners> stored{{40, 100, 160, 220}, {100, 40, 220, 160}, {220, 160, 100, 40}, {160, 220, 40, 100},
                                    {40, 160, 100, 220}, {100, 220, 40, 160}, {220, 100, 160, 40}, {160, 40, 220, 100}};
  const Folder folder;
  std::set<std::uint64_t> fingerprints;
  for (int orientation = 1; orientation <= 8; ++orientation)
    for (const std::string kind : {"little.jpg", "big.jpg", "before.png", "behind.png"}) {
      const cv::Size size = orientation < 5 ? cv::Size(64, 32) : cv::Size(32, 64);
      const std::string path = folder / (std::to_string(orientation) + kind);
      cv::imwrite(path, drawn(stored[static_cast<std::size_t>(orientation - 1)], size));
      std::string file = contents(path);
      const std::string data = exif(orientation, kind != "big.jpg");
      if (kind.ends_with("jpg"))
        file.insert(2, "\xFF\xE1" + big(static_cast<unsigned>(data.size()) + 8, 2) + std::string("Exif\0\0", 6) + data);
      else
        file.insert(kind == "before.png" ? 33 : file.size() - 12, png_chunk("eXIf" + data));
      make_file(path, file);
      const auto images = image_files({path}, folder.path());
      cv::Size shown;
      const Corners corners = seen(*images, shown);
      for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(corners[i], upright[i], 3) << path << ", corner " << i;
      EXPECT_EQ(shown, cv::Size(64, 32)) << path;
      fingerprints.insert(images->fingerprint(0));
    }
  EXPECT_EQ(fingerprints.size(), 32u);
}

/// Features are stored under fingerprints: a turned picture must not pass for what was stored of it before.
TEST(Orientation, ChangesTheFingerprintAndNothingElseDoes) {
  const Folder folder;
  write_grey(folder / "x.jpg", 100);
  const std::string plain = contents(folder / "x.jpg");
  for (const int orientation : {0, 1, 9, 255}) {
    const std::string data = exif(orientation, true);
    make_file(folder / "x.jpg", plain.substr(0, 2) + "\xFF\xE1" + big(static_cast<unsigned>(data.size()) + 8, 2) +
                                    std::string("Exif\0\0", 6) + data + plain.substr(2));
    Bytes bytes;
    image_files({folder / "x.jpg"}, "")->read(0, bytes);
    EXPECT_EQ(std::string(reinterpret_cast<const char*>(bytes.data()), bytes.size()), contents(folder / "x.jpg"));
  }
  // Broken EXIF data: counts and offsets beyond their end.
  for (const std::string& data :
       {std::string("II*\0\xFF\xFF\xFF\xFF", 8), std::string("MM\0*\0\0\0\x8\xFF\xFF\1\x12", 12), std::string()}) {
    make_file(folder / "x.jpg", plain.substr(0, 2) + "\xFF\xE1" + big(static_cast<unsigned>(data.size()) + 8, 2) +
                                    std::string("Exif\0\0", 6) + data + plain.substr(2));
    EXPECT_EQ(image_files({folder / "x.jpg"}, "")->fault(0), "");
  }
}

TEST(HalfDecoded, DamagedPixelsAreAnError) {
  const Folder folder;
  cv::Mat noise(96, 128, CV_8UC3);
  cv::randu(noise, 0, 256);
  for (const bool grey : {false, true})
    for (const int progressive : {0, 1}) {
      cv::Mat picture = noise;
      if (grey) cv::extractChannel(noise, picture, 0);
      cv::imwrite(folder / "x.jpg", picture, {cv::IMWRITE_JPEG_PROGRESSIVE, progressive});
      const std::string good = contents(folder / "x.jpg"), end = good.substr(good.size() - 2);
      const std::string half = good.substr(0, good.size() / 2);
      Bytes bytes;
      const auto fault = [&](const std::string& file) {
        make_file(folder / "x.jpg", file);
        double brightest = 0;
        return decoding_fault(*image_files({folder / "x.jpg"}, ""), 0, bytes, brightest);
      };
      EXPECT_EQ(fault(good), "");
      EXPECT_EQ(fault(good.substr(0, good.size() - 2) + std::string(3, '\0') + end), "") << "as some cameras pad";
      EXPECT_TRUE(contains(fault(half + end), "orrupt JPEG data") || contains(fault(half + end), "remature end"))
          << fault(half + end);
      EXPECT_NE(fault(half + std::string(good.size() / 4, 'x') + end), "");
      EXPECT_NE(fault(half + std::string(good.size() / 2 - 2, '\0') + end), "");
    }
}

}  // namespace
}  // namespace citylearn::testing
