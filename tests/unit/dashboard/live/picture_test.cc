// SPDX-License-Identifier: Apache-2.0
// Pictures on their way to browsers: kept for a while, and made small.
#include <gtest/gtest.h>

#include "core/files/image_header.h"
#include "dashboard/live/live.h"
#include "dashboard/live/picture_shrink.h"
#include "tests/support/data/sample_pictures.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST(PictureCache, KeepsWhatWasAskedForLately) {
  PictureCache cache(10 * (1000 + 256));
  const std::string bytes(1000, 'x');
  for (std::uint32_t frame = 0; frame < 10; ++frame) cache.put({1, frame}, {"image/jpeg", bytes});
  EXPECT_EQ(cache.bytes(), 10u * 1256);
  ASSERT_TRUE(cache.find({1, 0}));
  const auto held = cache.find({1, 1});
  cache.find({1, 0});
  cache.put({1, 10}, {"image/jpeg", bytes});
  EXPECT_TRUE(cache.find({1, 0})) << "asked for since";
  EXPECT_FALSE(cache.find({1, 2}));
  EXPECT_FALSE(cache.find({2, 0}));
  cache.put({1, 0}, {"image/png", "short"});
  EXPECT_EQ(cache.find({1, 0})->type, "image/png");
  cache.put({3, 0}, {"image/jpeg", std::string(20'000, 'x')});
  EXPECT_FALSE(cache.find({3, 0})) << "larger than all";
  for (std::uint32_t frame = 0; frame < 1000; ++frame) cache.put({4, frame}, {"image/jpeg", bytes});
  EXPECT_LE(cache.bytes(), 10u * 1256);
  EXPECT_EQ(held->bytes, bytes) << "a picture in use stays valid";
}

Bytes encoded(const std::string& extension, int width, int height) {
  std::vector<std::uint8_t> file;
  cv::imencode(extension, drawn_picture(width, height, 3), file);
  const auto* begin = reinterpret_cast<const std::byte*>(file.data());
  return {begin, begin + file.size()};
}

std::string text_of(const Bytes& bytes) { return {reinterpret_cast<const char*>(bytes.data()), bytes.size()}; }

ImageHeader header_of(const PictureFile& picture) {
  return read_image_header(std::as_bytes(std::span(picture.bytes)), "picture");
}

TEST(PictureShrink, LeavesSmallOnesAsTheyAreAndMakesTheOthersSmallJpegs) {
  for (const std::string type : {"jpeg", "png"}) {
    const Bytes file = encoded(type == "jpeg" ? ".jpg" : ".png", 320, 200);
    const PictureFile picture = shrink(file, {640}, "x");
    EXPECT_EQ(picture.type, "image/" + type);
    EXPECT_EQ(picture.bytes, text_of(file));
  }
  for (const std::string extension : {".jpg", ".png", ".ppm", ".bmp"})
    for (const int width : {320, 1000, 1300, 2600, 5300}) {
      if (width == 320 && (extension == ".jpg" || extension == ".png")) continue;
      const PictureFile picture = shrink(encoded(extension, width, 120), {640}, "x");
      EXPECT_EQ(picture.type, "image/jpeg");
      EXPECT_EQ(header_of(picture).format, "jpeg");
      EXPECT_EQ(header_of(picture).width, std::min(width, 640)) << extension << " " << width;
      EXPECT_NEAR(header_of(picture).height, 120.0 * std::min(width, 640) / width, 1.5) << extension << " " << width;
    }
}

TEST(PictureShrink, ConvertsWhatHasTooManyBytes) {
  const Bytes file = encoded(".png", 320, 200);
  const PictureFile picture = shrink(file, {640, file.size() - 1}, "x");
  EXPECT_EQ(picture.type, "image/jpeg");
  EXPECT_EQ(header_of(picture).width, 320);
}

TEST(PictureShrink, RefusesWhatIsNoPicture) {
  Bytes cut = encoded(".png", 1000, 100);
  cut.resize(200);
  for (const Bytes& file : {Bytes(), Bytes(100), cut}) {
    EXPECT_TRUE(contains(error_of([&] { shrink(file, {640}, "frame 7"); }), "frame 7"));
  }
}

}  // namespace
}  // namespace citylearn::testing
