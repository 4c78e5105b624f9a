// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "tests/paths.h"
#include "tests/support/data/layouts.h"
#include "tests/support/data/real_data.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

/// Three frames 0.1 s apart, going north from the equator by a thousandth of a degree each.
class KittiRaw : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string times;
    for (int i = 0; i < 3; ++i) {
      const std::string number = "000000000" + std::to_string(i);
      write_picture(drive_ + "/image_02/data/" + number + ".png", cv::Scalar::all(50 + 50 * i));
      make_file(drive_ + "/oxts/data/" + number + ".txt",
                std::to_string(0.001 * i) + " 8.4 116.4 0.03 0.009 -2.6 -6.8 -11.2 13.1\n");
      times += "2011-09-26 13:02:25.9" + std::to_string(i) + "0000000\n";
    }
    make_file(drive_ + "/image_02/timestamps.txt", times);
    make_file(drive_ + "/oxts/timestamps.txt", times);
  }
  Traversal load(const std::map<std::string, double>& parameters = {}) const {
    return make_dataset("kitti", folder_.path(), parameters)->load("2011_09_26_drive_0001_sync");
  }

  Folder folder_;
  std::string drive_ = folder_ / "2011_09_26/2011_09_26_drive_0001_sync";
};

TEST_F(KittiRaw, ReadsADrive) {
  EXPECT_EQ(make_dataset("kitti", folder_.path())->names(), std::vector<std::string>{"2011_09_26_drive_0001_sync"});
  EXPECT_EQ(make_dataset("kitti", folder_ / "2011_09_26")->names().size(), 1u);  // the folder of the date will do
  const Traversal traversal = load();
  ASSERT_EQ(traversal.frames, 3);
  EXPECT_NEAR(traversal.times[0], 1317042145.90, 1e-6);  // date -u -d '2011-09-26 13:02:25' +%s
  EXPECT_NEAR(traversal.times[2] - traversal.times[0], 0.02, 1e-6);
  for (int frame = 0; frame < 3; ++frame) EXPECT_NEAR(traversal.positions[frame], 0.001 * frame * kDegree, 0.01);
  EXPECT_NEAR(traversal.longitude[1], 8.4, 1e-9);
  EXPECT_EQ(picture_of(traversal, 1).at<cv::Vec3b>(0, 0), cv::Vec3b(100, 100, 100));
}

TEST_F(KittiRaw, PositionsAreThoseOfThePicturesTimes) {
  // The packets came when the pictures were half way.
  make_file(drive_ + "/oxts/timestamps.txt",
            "2011-09-26 13:02:25.895000000\n2011-09-26 13:02:25.905000000\n2011-09-26 13:02:25.915000000\n");
  EXPECT_NEAR(load().latitude[0], 0.0005, 1e-7);
  EXPECT_NEAR(load().latitude[1], 0.0015, 1e-7);
}

TEST_F(KittiRaw, LatePacketsArePassedOver) {
  make_file(drive_ + "/oxts/timestamps.txt",
            "2011-09-26 13:02:25.900000000\n2011-09-26 13:02:25.890000000\n2011-09-26 13:02:25.920000000\n");
  EXPECT_NEAR(load().latitude[1], 0.001, 1e-7);  // between packets 0 and 2
}

TEST_F(KittiRaw, MissingPacketsArePassedOver) {
  const Log log;
  EXPECT_NEAR(load().latitude[1], 0.001, 1e-7);
  EXPECT_EQ(log.text(), "");
  fs::remove(drive_ + "/oxts/data/0000000001.txt");
  EXPECT_NEAR(load().latitude[1], 0.001, 1e-7);  // between packets 0 and 2
  EXPECT_TRUE(log.has("oxts/data/0000000001.txt: no such packet (1 of 3 are missing); places are")) << log.text();
  fs::remove(drive_ + "/oxts/data/0000000002.txt");
  EXPECT_NEAR(load().latitude[2], 0, 1e-7);  // the nearest
  EXPECT_TRUE(log.has("oxts/data/0000000001.txt: no such packet (2 of 3 are missing);")) << log.text();
  fs::remove(drive_ + "/oxts/data/0000000000.txt");
  EXPECT_TRUE(std::isnan(load().positions[0]));
}

TEST_F(KittiRaw, TellsWhatIsMissingOrBroken) {
  fs::remove(drive_ + "/image_02/data/0000000001.png");
  make_file(drive_ + "/image_02/data/0000000002.png", "broken");
  const Traversal traversal = load();
  EXPECT_NE(traversal.images->fault(1), "");
  EXPECT_NE(traversal.images->fault(2), "");
  EXPECT_TRUE(holds(traversal.images->name(1), "0000000001.png"));
  make_file(drive_ + "/oxts/data/0000000002.txt", "");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "oxts/data/0000000002.txt: is not an OXTS packet of one line"));
  make_file(drive_ + "/oxts/data/0000000002.txt", "north east\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "oxts/data/0000000002.txt:1"));
  make_file(drive_ + "/image_02/timestamps.txt", "2011-09-26 13:02:25.9\n26.9.2011 1 p.m.\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "image_02/timestamps.txt:2"));
  fs::remove_all(drive_ + "/oxts");
  fs::remove(drive_ + "/image_02/timestamps.txt");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "image_02/timestamps.txt"));
}

TEST_F(KittiRaw, OtherFoldersAreNotIt) {
  const Folder other;
  EXPECT_TRUE(holds(error_of([&] { make_dataset("kitti", other.path())->names(); }), "image_2"));
  EXPECT_TRUE(holds(error_of([&] { make_dataset("kitti", other / "none")->names(); }), "no such folder"));
  EXPECT_TRUE(holds(error_of([&] { make_dataset("kitti", folder_.path(), {{"camera", 0}})->names(); }), "image_00"));
}

TEST(KittiOdometry, ReadsASequence) {
  const Folder folder;
  for (int i = 0; i < 3; ++i) write_picture(folder / "sequences/04/image_2/00000" + std::to_string(i) + ".png");
  make_file(folder / "sequences/04/times.txt", "0.0e+00\n1.03e-01\n2.07e-01\n");
  // Translations (0 0 0), (1 2 2), (1 2 5): steps of 3 m each.
  make_file(folder / "poses/04.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 1 0 1 0 2 0 0 1 2\n1 0 0 1 0 1 0 2 0 0 1 5\n");
  const auto dataset = make_dataset("kitti", folder.path());
  EXPECT_EQ(dataset->names(), std::vector<std::string>{"04"});
  EXPECT_EQ(dataset->correspondence(), Correspondence::kDistance);
  const Traversal traversal = dataset->load("04");
  EXPECT_EQ(traversal.positions, (std::vector<float>{0, 3, 6}));
  EXPECT_EQ(traversal.x, (std::vector<double>{0, 1, 1}));
  EXPECT_EQ(traversal.y, (std::vector<double>{0, 2, 5}));
  EXPECT_EQ(traversal.height, (std::vector<double>{0, -2, -2}));
  EXPECT_NEAR(traversal.times[2], 0.207, 1e-12);
  const std::uint64_t hash = traversal.hash();
  write_picture(folder / "sequences/04/image_2/000001.png", {9, 9, 9});
  EXPECT_NE(make_dataset("kitti", folder.path())->load("04").hash(), hash);

  make_file(folder / "poses/04.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->load("04"); }), "poses/04.txt: has 1 poses"));
  make_file(folder / "poses/04.txt", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0\n1 0 0 0 0 1 0 0 0 0 1 0\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->load("04"); }), "poses/04.txt:2"));
  fs::remove(folder / "poses/04.txt");
  EXPECT_TRUE(std::isnan(dataset->load("04").positions[2]));
}

TEST(KittiReal, Sequence00IsAsLongAsTheBenchmarkSays) {
  const std::string samples = real_data(CITYLEARN_SOURCE_DIR, "formats/kitti_odometry");
  if (samples.empty()) GTEST_SKIP() << "skipped: no samples of the layout; CITYLEARN_DATA names their folder";
  const Folder folder;
  write_picture(folder / "sequences/00/image_2/000000.png");
  fs::create_directories(folder / "poses");
  fs::create_symlink(fs::absolute(samples + "/KITTI_00_gt.txt"), folder / "poses/00.txt");
  fs::create_symlink(fs::absolute(samples + "/KITTI_00_gt_times.txt"), folder / "sequences/00/times.txt");
  const Traversal traversal = make_dataset("kitti", folder.path())->load("00");
  EXPECT_EQ(traversal.frames, 4541);
  EXPECT_NEAR(traversal.positions.back(), 3724, 1);
  EXPECT_NE(traversal.images->fault(1), "");
}

TEST(KittiReal, TimesAndAPacketOfARawDrive) {
  const std::string samples = real_data(CITYLEARN_SOURCE_DIR, "formats/kitti_raw/2011_09_26_drive_0001_sync");
  if (samples.empty()) GTEST_SKIP() << "skipped: no samples of the layout; CITYLEARN_DATA names their folder";
  const std::string name = "2011_09_26_drive_0001_sync";
  const auto dataset = make_dataset("kitti", samples);
  EXPECT_EQ(dataset->names(), std::vector<std::string>{name});
  {
    const Log log;
    EXPECT_EQ(dataset->load(name).frames, 108);
    EXPECT_TRUE(log.has("oxts/data/0000000001.txt: no such packet (107 of 108 are missing)")) << log.text();
  }

  const Folder folder;
  const std::string drive = samples + "/2011_09_26/" + name;
  fs::create_directories(folder / name + "/oxts/data");
  fs::create_symlink(fs::absolute(drive + "/image_02"), folder / name + "/image_02");
  fs::create_symlink(fs::absolute(drive + "/oxts/timestamps.txt"), folder / name + "/oxts/timestamps.txt");
  for (int i = 0; i < 108; ++i) {
    std::string number = std::to_string(i);
    number.insert(0, 10 - number.size(), '0');
    fs::create_symlink(fs::absolute(drive + "/oxts/data/0000000000.txt"),
                       folder / name + "/oxts/data/" + number + ".txt");
  }
  const Traversal traversal = make_dataset("kitti", folder.path())->load(name);
  EXPECT_EQ(traversal.frames, 108);
  EXPECT_NEAR(traversal.times[1] - traversal.times[0], 0.103123456, 1e-6);
  EXPECT_NEAR(traversal.latitude[50], 49.015003823272, 1e-12);
  EXPECT_NEAR(traversal.longitude[50], 8.4342971002335, 1e-12);
  EXPECT_FLOAT_EQ(traversal.positions[107], 0);
}

TEST(KittiReal, PicturesOfARawDrive) {
  const std::string samples = real_data(CITYLEARN_SOURCE_DIR, "kitti-raw-sample");
  if (samples.empty()) GTEST_SKIP() << "skipped: no sample of a drive; CITYLEARN_DATA names its folder";
  const Traversal drive = make_dataset("kitti", samples, {{"camera", 0}})->load("2011_09_26_drive_0002_sync");
  ASSERT_EQ(drive.frames, 10);
  EXPECT_NEAR(drive.positions.back(), 8.18, 0.02);
  for (int frame = 0; frame < drive.frames; ++frame) EXPECT_EQ(drive.images->fault(frame), "");
  EXPECT_EQ(picture_of(drive, 3).size(), cv::Size(1242, 375));
}

}  // namespace
}  // namespace citylearn::testing
