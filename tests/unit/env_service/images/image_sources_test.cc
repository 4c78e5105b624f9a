// SPDX-License-Identifier: Apache-2.0
// Pictures in files and in videos.
#include "env_service/images/image_sources.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <chrono>
#include <set>

#include "env_service/files/files.h"
#include "tests/paths.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

int brightness(Images& images, int frame) {
  Bytes bytes;
  images.read(frame, bytes);
  const cv::Mat picture = decode_image(bytes, images.name(frame));
  EXPECT_EQ(picture.type(), CV_8UC3);
  return picture.at<cv::Vec3b>(picture.rows / 2, picture.cols / 2)[0];
}

std::string png_header(unsigned width, unsigned height) {
  std::string text("\x89PNG\r\n\x1A\n\0\0\0\rIHDR", 16);
  for (const unsigned side : {width, height})
    for (int shift = 24; shift >= 0; shift -= 8) text += static_cast<char>(side >> shift);
  return text + std::string("\x08\x02\0\0\0", 5) + "....IEND....";
}

TEST(ImageFiles, ReadsAndNamesFrames) {
  const Folder folder;
  write_grey(folder / "day/a.png", 10);
  write_grey(folder / "day/b.jpg", 20);
  write_grey(folder / "night/a.bmp", 30);
  write_grey(folder / "night/b.ppm", 40);
  const auto images = image_files(
      {folder / "day/a.png", folder / "day/b.jpg", folder / "night/a.bmp", folder / "night/b.ppm"}, folder.path());
  ASSERT_EQ(images->frames(), 4);
  EXPECT_EQ(images->name(0), "day/a.png");
  EXPECT_EQ(images->name(3), "night/b.ppm");
  std::set<std::uint64_t> fingerprints;
  for (int frame = 0; frame < 4; ++frame) {
    EXPECT_EQ(images->fault(frame), "");
    EXPECT_NEAR(brightness(*images, frame), 10 + 10 * frame, 2);
    fingerprints.insert(images->fingerprint(frame));
  }
  EXPECT_EQ(fingerprints.size(), 4u);
  // The same picture elsewhere has the same fingerprint.
  std::filesystem::copy_file(folder / "day/a.png", folder / "night/c.png");
  EXPECT_EQ(image_files({folder / "night/c.png"}, "")->fingerprint(0), images->fingerprint(0));
  EXPECT_EQ(image_files({folder / "night/c.png"}, "")->name(0), folder / "night/c.png");
}

TEST(ImageFiles, TellsWhatIsBroken) {
  const Folder folder;
  write_grey(folder / "good.png", 10);
  write_grey(folder / "good.jpg", 10);
  const std::string png = contents(folder / "good.png"), jpeg = contents(folder / "good.jpg");
  make_file(folder / "empty.png", "");
  make_file(folder / "text.png", "hello");
  make_file(folder / "cut.png", png.substr(0, png.size() / 2));
  make_file(folder / "cut.jpg", jpeg.substr(0, jpeg.size() - 20));
  make_file(folder / "huge.png", png_header(40000, 40000));
  make_file(folder / "none.png", png_header(0, 5));
  std::filesystem::create_directory(folder / "folder.png");
  ASSERT_EQ(::mkfifo((folder / "fifo.png").c_str(), 0600), 0);
  const std::vector<std::pair<std::string, std::string>> cases{
      {"missing.png", "missing"},
      {"empty.png", "an empty file"},
      {"text.png", "neither a JPEG, PNG, PNM nor BMP file"},
      {"cut.png", "the PNG file is cut short"},
      {"cut.jpg", "the JPEG file is cut short"},
      {"huge.png", "an image of 40000 x 40000 pixels, at most 67108864 are allowed"},
      {"none.png", "an image of 0 x 5 pixels"},
      {"folder.png", "not a file"},
      {"fifo.png", "not a file"}};
  std::vector<std::string> paths{folder / "good.png"};
  for (const auto& [name, fault] : cases) paths.push_back(folder / name);
  const auto images = image_files(paths, folder.path());
  EXPECT_EQ(images->fault(0), "");
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const int frame = static_cast<int>(i) + 1;
    EXPECT_EQ(images->fault(frame), cases[i].second) << cases[i].first;
    Bytes bytes;
    EXPECT_EQ(error_of([&] { images->read(frame, bytes); }), folder / (cases[i].first + ": " + cases[i].second));
  }
}

/// Features are stored under the fingerprints, so others' pixels must not pass for them.
TEST(ImageFiles, APictureThatChangedIsRefused) {
  const Folder folder;
  write_grey(folder / "x.png", 10);
  const auto images = image_files({folder / "x.png"}, "");
  EXPECT_NEAR(brightness(*images, 0), 10, 2);
  write_grey(folder / "x.png", 200);
  EXPECT_TRUE(contains(error_of([&] { brightness(*images, 0); }), "x.png: has changed since"));
}

TEST(ImageFiles, LooksAtARealTraversalAtOnce) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "nordland-64x32/summer");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  std::vector<std::string> paths;
  for (const std::string& name : files_in(folder, image_suffixes())) paths.push_back(folder + "/" + name);
  ASSERT_EQ(paths.size(), 3576u);
  const auto begin = std::chrono::steady_clock::now();
  const auto images = image_files(paths, folder);
  const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
  RecordProperty("seconds", std::to_string(seconds.count()));
  EXPECT_LT(seconds.count(), 5);  // some 0.1 on a quiet machine
  for (int frame = 0; frame < images->frames(); ++frame) EXPECT_EQ(images->fault(frame), "");
}

TEST(Decoding, BrokenPixelsAreAnError) {
  const std::string text = png_header(64, 64);
  Bytes bytes(text.size());
  std::memcpy(bytes.data(), text.data(), text.size());
  EXPECT_EQ(error_of([&] { decode_image(bytes, "x.png"); }), "x.png: the picture cannot be decoded (replace the file)");
}

TEST(Encoding, PngOfGreyAndColours) {
  for (const int type : {CV_8UC1, CV_8UC3}) {
    Bytes bytes;
    encode_png(cv::Mat(5, 7, type, cv::Scalar(1, 2, 3)), bytes);
    const cv::Mat picture = decode_image(bytes, "x");
    EXPECT_EQ(picture.size(), cv::Size(7, 5));
    EXPECT_EQ(picture.at<cv::Vec3b>(4, 6), type == CV_8UC1 ? cv::Vec3b(1, 1, 1) : cv::Vec3b(1, 2, 3));
  }
  Bytes bytes;
  EXPECT_NE(error_of([&] { encode_png(cv::Mat(5, 7, CV_32F), bytes); }), "");
  EXPECT_NE(error_of([&] { encode_png(cv::Mat(), bytes); }), "");
}

TEST(Video, NamesAndFingerprints) {
  const Folder folder;
  ASSERT_TRUE(write_video(folder / "m.avi", 20));
  const auto images = video_frames(folder / "m.avi", folder.path());
  ASSERT_EQ(images->frames(), 20);
  EXPECT_EQ(images->name(12), "m.avi, frame 12");
  EXPECT_NEAR(brightness(*images, 12), 4 * 12 + 20, 3);
  std::set<std::uint64_t> fingerprints;
  for (int frame = 0; frame < 20; ++frame) fingerprints.insert(images->fingerprint(frame));
  EXPECT_EQ(fingerprints.size(), 20u);
  Bytes bytes;
  EXPECT_EQ(error_of([&] { images->read(20, bytes); }), "m.avi: no frame 20");
}

TEST(Changed, PicturesAndFingerprints) {
  const Folder folder;
  write_grey(folder / "a.png", 100);
  const auto images = image_files({folder / "a.png", folder / "none.png"}, folder.path());
  const auto halved = changed(images, "halve 1", [](const cv::Mat& picture) { return cv::Mat(picture / 2); });
  EXPECT_EQ(brightness(*halved, 0), 50);
  EXPECT_EQ(halved->name(0), "a.png");
  EXPECT_EQ(halved->fault(1), "missing");
  EXPECT_NE(halved->fingerprint(0), images->fingerprint(0));
  EXPECT_NE(halved->fingerprint(0), changed(images, "halve 2", nullptr)->fingerprint(0));
  const auto broken = changed(images, "crop", [](const cv::Mat& picture) { return picture(cv::Rect(0, 0, 999, 9)); });
  Bytes bytes;
  EXPECT_TRUE(error_of([&] { broken->read(0, bytes); }).starts_with("a.png (crop): "));
}

TEST(Moved, ByAShareOfTheWidth) {
  const Folder folder;
  write_grey(folder / "a.png", 1);
  const auto ramp = changed(image_files({folder / "a.png"}, folder.path()), "ramp", [](const cv::Mat&) {
    cv::Mat picture(1, 40, CV_8UC1);
    for (int x = 0; x < 40; ++x) picture.at<unsigned char>(0, x) = static_cast<unsigned char>(5 * x);
    return picture;
  });
  for (const double share : {0.075, -0.075}) {  // three pixels of 40
    const auto images = moved(ramp, share);
    EXPECT_NE(images->fingerprint(0), ramp->fingerprint(0));
    Bytes bytes;
    images->read(0, bytes);
    const cv::Mat picture = decode_image(bytes, "");
    ASSERT_EQ(picture.size(), cv::Size(40, 1));
    for (int x = 0; x < 40; ++x)
      EXPECT_EQ(picture.at<cv::Vec3b>(0, x)[0], 5 * (share > 0 ? std::max(0, x - 3) : std::min(39, x + 3))) << x;
  }
}

TEST(Picked, FramesInTheirOrder) {
  const Folder folder;
  for (int i = 0; i < 3; ++i) write_grey(folder / (std::to_string(i) + ".png"), 10 * i);
  const auto images = image_files({folder / "0.png", folder / "1.png", folder / "2.png"}, folder.path());
  const auto some = picked(images, {2, 0, 2});
  ASSERT_EQ(some->frames(), 3);
  EXPECT_EQ(brightness(*some, 0), 20);
  EXPECT_EQ(some->name(1), "0.png");
  EXPECT_EQ(some->fingerprint(2), images->fingerprint(2));
  EXPECT_NE(error_of([&] { picked(images, {0, 3}); }), "");
  EXPECT_NE(error_of([&] { picked(images, {-1}); }), "");
}

/// Counts its reads.
class Counting : public FakeImages {
 public:
  Counting() : FakeImages(10) {}
  void read(int frame, Bytes& bytes) override {
    bytes.assign(100, std::byte(frame));
    ++reads;
  }
  int reads = 0;
};

TEST(Cached, KeepsWhatWasReadLast) {
  const auto images = std::make_shared<Counting>();
  const auto kept = cached(images, 250);  // two of them
  Bytes bytes;
  for (const int frame : {1, 2, 1, 2, 1}) {
    kept->read(frame, bytes);
    EXPECT_EQ(bytes, Bytes(100, std::byte(frame)));
  }
  EXPECT_EQ(images->reads, 2);
  kept->read(3, bytes);  // 2 goes, for 1 was read later
  kept->read(1, bytes);
  EXPECT_EQ(images->reads, 3);
  kept->read(2, bytes);
  EXPECT_EQ(images->reads, 4);
  const auto small = cached(images, 50);
  for (int i = 0; i < 2; ++i) small->read(1, bytes);
  EXPECT_EQ(images->reads, 6);
}

}  // namespace
}  // namespace citylearn::testing
