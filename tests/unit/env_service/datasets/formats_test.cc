// SPDX-License-Identifier: Apache-2.0
// Oxford RobotCar and KITTI.
#include <algorithm>
#include <cmath>

#include "tests/paths.h"
#include "tests/support/data/layouts.h"
#include "tests/support/log.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

constexpr char kDrive[] = "2014-05-14-13-46-12";
constexpr char kInsHeader[] =
    "timestamp,ins_status,latitude,longitude,altitude,northing,easting,down,utm_zone,velocity_north,velocity_east,"
    "velocity_down,roll,pitch,yaw\n";

std::string ins_row(long stamp, double latitude, double longitude, double northing, double easting) {
  return std::to_string(stamp) + ",INS_SOLUTION_GOOD," + std::to_string(latitude) + "," + std::to_string(longitude) +
         ",110," + std::to_string(northing) + "," + std::to_string(easting) + ",-110,30U,0,0,0,0,0,0\n";
}

/// Three frames 0.1 s apart.
class Robotcar : public ::testing::Test {
 protected:
  void write_frames(const std::string& camera, const std::string& timestamps) const {
    std::string text;
    for (int i = 0; i < 3; ++i) {
      const std::string stamp = std::to_string(1400075172000000L + 100000L * i);
      write_picture(drive_ + "/" + camera + "/" + stamp + ".png", cv::Scalar::all(50 + 50 * i));
      text += stamp + " 1\n";
    }
    // A chunk that nobody fetched.
    make_file(drive_ + "/" + timestamps, text + "1400075172300000 2\n1400075172400000 2\n");
  }
  Traversal load(const std::map<std::string, double>& parameters = {}) const {
    return make_dataset("oxford_robotcar", folder_.path(), parameters)->load(kDrive);
  }

  Folder folder_;
  std::string drive_ = folder_ / kDrive;
};

TEST_F(Robotcar, ReadsADriveWithInsPositions) {
  write_frames("stereo/centre", "stereo.timestamps");
  make_file(folder_ / "tags/2014-05-14-13-46-12.yaml", "- sun\n- alternate-route\n- clouds");
  make_file(drive_ + "/gps/ins.csv", kInsHeader + ins_row(1400075171900000, 0, 0, 0, 0) +
                                         ins_row(1400075172000000, 51.75, -1.25, 5735000, 619000) +
                                         ins_row(1400075172200000, 51.76, -1.26, 5735006, 619008));
  const auto dataset = make_dataset("oxford_robotcar", folder_.path());
  EXPECT_EQ(dataset->names(), std::vector<std::string>{kDrive});
  EXPECT_EQ(dataset->condition(kDrive), "sun+clouds");
  EXPECT_EQ(dataset->correspondence(), Correspondence::kGps);
  const Traversal traversal = dataset->load(kDrive);
  EXPECT_EQ(traversal.dataset, "oxford_robotcar");
  EXPECT_EQ(traversal.condition, "sun+clouds");
  ASSERT_EQ(traversal.frames, 3);
  ASSERT_EQ(traversal.images->frames(), 3);
  EXPECT_NEAR(traversal.times[1], 1400075172.1, 1e-5);
  // The row of zeros is no solution; between the others frame 1 is half way, 5 m of 10 m (6 north, 8 east).
  EXPECT_NEAR(traversal.positions[0], 0, 1e-3);
  EXPECT_NEAR(traversal.positions[1], 5, 1e-3);
  EXPECT_NEAR(traversal.positions[2], 10, 1e-3);
  EXPECT_NEAR(traversal.latitude[1], 51.755, 1e-7);
  EXPECT_NEAR(traversal.longitude[1], -1.255, 1e-7);
  for (int frame = 0; frame < 3; ++frame) EXPECT_EQ(traversal.images->fault(frame), "");
}

TEST_F(Robotcar, RowsOutOfOrderAreSortedWithAWarning) {
  write_frames("stereo/centre", "stereo.timestamps");
  make_file(drive_ + "/gps/ins.csv", kInsHeader + ins_row(1400075172000000, 51.75, -1.25, 5735000, 619000) +
                                         ins_row(1400075172200000, 51.76, -1.26, 5735006, 619008) +
                                         ins_row(1400075172100000, 51.755, -1.255, 5735003, 619004));
  const Log log;
  const Traversal traversal = load();
  EXPECT_TRUE(log.has("gps/ins.csv:4: its time is before that of the row before; rows are sorted by time"))
      << log.text();
  for (int frame = 0; frame < 3; ++frame) EXPECT_NEAR(traversal.positions[frame], 5 * frame, 1e-3);
}

TEST_F(Robotcar, TagsInAnyOrderAreOneCondition) {
  write_frames("stereo/centre", "stereo.timestamps");
  for (const char* tags : {"- overcast\n- partial\n", "- partial\n- detour\n- overcast\n"}) {
    make_file(folder_ / "tags/2014-05-14-13-46-12.yaml", tags);
    EXPECT_EQ(make_dataset("oxford_robotcar", folder_.path())->condition(kDrive), "overcast+partial") << tags;
  }
}

TEST_F(Robotcar, RtkBeforeInsAndOdometryLast) {
  write_frames("stereo/centre", "stereo.timestamps");
  // Steps of 3 m and of 4 m sideways and 3 m up, each told with its end first, as the SDK reads them.
  make_file(drive_ + "/vo/vo.csv",
            "source_timestamp,destination_timestamp,x,y,z,roll,pitch,yaw\n"
            "1400075172100000,1400075172000000,3,0,0,0,0,0.1\n"
            "1400075172200000,1400075172100000,0,4,3,0,0,0.1\n");
  Traversal traversal = load();
  EXPECT_FLOAT_EQ(traversal.positions[0], 0);
  EXPECT_NEAR(traversal.positions[1], 3, 1e-4);
  EXPECT_NEAR(traversal.positions[2], 8, 1e-4);
  EXPECT_TRUE(traversal.latitude.empty());

  make_file(drive_ + "/gps/ins.csv",
            kInsHeader + ins_row(1400075172000000, 51, -1, 0, 0) + ins_row(1400075172200000, 51, -1, 10, 0));
  EXPECT_NEAR(load().positions[2], 10, 1e-3);
  make_file(drive_ + "/rtk.csv",
            kInsHeader + ins_row(1400075172000000, 51, -1, 0, 0) + ins_row(1400075172200000, 51, -1, 20, 0));
  EXPECT_NEAR(load().positions[2], 20, 1e-3);
}

// A mosaic of pure red holds light only where the pattern has red: which pixel that is tells the patterns apart.
TEST_F(Robotcar, RawPicturesBecomeColours) {
  write_frames("stereo/centre", "stereo.timestamps");
  write_frames("mono_left", "mono_left.timestamps");
  const auto mosaic = [](int row, int column) {
    cv::Mat raw = cv::Mat::zeros(16, 16, CV_8UC1);
    for (int y = row; y < 16; y += 2)
      for (int x = column; x < 16; x += 2) raw.at<uchar>(y, x) = 200;
    return raw;
  };
  ASSERT_TRUE(cv::imwrite(drive_ + "/stereo/centre/1400075172000000.png", mosaic(1, 0)));  // GB / RG
  ASSERT_TRUE(cv::imwrite(drive_ + "/mono_left/1400075172000000.png", mosaic(0, 0)));      // RG / GB
  for (const int camera : {0, 3}) {
    const cv::Vec3b pixel = picture_of(load({{"camera", camera}}), 0).at<cv::Vec3b>(8, 8);
    EXPECT_EQ(pixel, cv::Vec3b(0, 0, 200)) << camera;
  }
  const cv::Mat reduced = picture_of(load({{"reduce", 2}}), 0);
  EXPECT_EQ(reduced.size(), cv::Size(8, 8));
  EXPECT_EQ(reduced.at<cv::Vec3b>(4, 4), cv::Vec3b(0, 0, 200));
  EXPECT_EQ(picture_of(load({{"raw", 0}, {"reduce", 4}}), 0).at<cv::Vec3b>(2, 2), cv::Vec3b(50, 50, 50));
  const cv::Mat grey = picture_of(load({{"raw", 0}}), 0);
  EXPECT_EQ(grey.at<cv::Vec3b>(1, 0), cv::Vec3b(200, 200, 200));
  EXPECT_EQ(grey.at<cv::Vec3b>(0, 0), cv::Vec3b(0, 0, 0));
}

TEST_F(Robotcar, FingerprintsFollowPicturesAndDemosaicing) {
  write_frames("stereo/centre", "stereo.timestamps");
  const std::uint64_t before = load().images->fingerprint(0);
  EXPECT_NE(before, load().images->fingerprint(1));
  EXPECT_EQ(before, load().images->fingerprint(0));
  EXPECT_NE(before, load({{"raw", 0}}).images->fingerprint(0));
  EXPECT_NE(before, load({{"reduce", 2}}).images->fingerprint(0));
  write_picture(drive_ + "/stereo/centre/1400075172000000.png", {1, 2, 3});
  EXPECT_NE(before, load().images->fingerprint(0));
}

TEST_F(Robotcar, TellsWhatIsMissingOrBroken) {
  write_frames("stereo/centre", "stereo.timestamps");
  fs::remove(drive_ + "/stereo/centre/1400075172100000.png");
  make_file(drive_ + "/stereo/centre/1400075172200000.png", "not a picture");
  const Traversal traversal = load();
  ASSERT_EQ(traversal.frames, 3);  // two of three: the chunk counts
  EXPECT_EQ(traversal.images->fault(0), "");
  EXPECT_NE(traversal.images->fault(1), "");
  EXPECT_NE(traversal.images->fault(2), "");
  Bytes bytes;
  for (const int frame : {1, 2})
    EXPECT_TRUE(holds(error_of([&] {
                        traversal.images->read(frame, bytes);
                        decode_image(bytes, traversal.images->name(frame));
                      }),
                      std::to_string(1400075172000000L + 100000L * frame) + ".png"));

  make_file(drive_ + "/gps/ins.csv",
            std::string(kInsHeader) + "1400075172000000,GOOD,here,-1,0,0,0,0,30U,0,0,0,0,0,0\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "gps/ins.csv:2"));
  make_file(drive_ + "/gps/ins.csv", "timestamp,latitude\n1,2\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "gps/ins.csv"));
}

TEST_F(Robotcar, ThinnedPicturesAreNotMissing) {
  write_frames("stereo/centre", "stereo.timestamps");
  std::string stamps;
  for (int i = 0; i < 30; ++i) stamps += std::to_string(1400075172000000L + 10000L * i) + " 1\n";
  make_file(drive_ + "/stereo.timestamps", stamps);
  EXPECT_EQ(load().frames, 3);
  fs::remove(drive_ + "/stereo.timestamps");
  EXPECT_EQ(load().frames, 3);
  make_file(drive_ + "/stereo.timestamps", "1400075172000000 1\n14000751721 1\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "stereo.timestamps:2"));
  make_file(drive_ + "/stereo.timestamps", "1400075172000000 1\n1400075172000000 1\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "stereo.timestamps:2"));
}

TEST_F(Robotcar, OtherFoldersAreNotIt) {
  EXPECT_TRUE(holds(error_of([&] { make_dataset("oxford_robotcar", folder_.path())->names(); }), "stereo/centre"));
  write_frames("stereo/centre", "stereo.timestamps");
  EXPECT_TRUE(holds(error_of([&] {
                      make_dataset("oxford_robotcar", folder_.path(), {{"camera", 5}})->names();
                    }),
                    "mono_rear"));
  EXPECT_TRUE(holds(error_of([&] { make_dataset("oxford_robotcar", folder_.path())->load("2014"); }), kDrive));
  EXPECT_TRUE(holds(error_of([&] { make_dataset("oxford_robotcar"); }), "--data"));
}

TEST(RobotcarReal, TagsOfTheSdk) {
  const std::string samples = real_data(CITYLEARN_SOURCE_DIR, "formats/robotcar");
  if (samples.empty()) GTEST_SKIP() << "skipped: no samples of the layout; CITYLEARN_DATA names their folder";
  std::map<std::string, int> conditions;
  const auto dataset = make_dataset("oxford_robotcar", samples);
  for (const auto& tags : fs::directory_iterator(samples + "/tags"))
    ++conditions[dataset->condition(tags.path().stem())];
  int all = 0;
  for (const auto& [condition, count] : conditions) all += count;
  EXPECT_EQ(all, 134);
  EXPECT_EQ(dataset->condition("2014-05-14-13-46-12"), "sun");
  EXPECT_EQ(dataset->condition("2014-05-06-12-54-54"), "sun+clouds");
  EXPECT_GT(conditions["overcast"], 20);
  EXPECT_GE(conditions["night"], 5);
  const auto rainy = [](const auto& one) { return one.first.find("rain") != std::string::npos; };
  EXPECT_GE(std::count_if(conditions.begin(), conditions.end(), rainy), 1);
}

TEST(RobotcarReal, TimesOfTheSunDrive) {
  const std::string samples = real_data(CITYLEARN_SOURCE_DIR, "formats/vprsnn/dataset_imagenames");
  if (samples.empty()) GTEST_SKIP() << "skipped: no samples of the layout; CITYLEARN_DATA names their folder";
  const TextTable list(samples + "/ORC_Sun_timestamps.csv", {});
  const Folder folder;
  const std::string name = "2015-08-12-15-04-18";
  for (int row = 0; row < 5; ++row)
    write_picture(folder / name + "/stereo/centre/" + std::string(list.text(row, "Image from ORC")));
  const Traversal traversal = make_dataset("oxford_robotcar", folder.path())->load(name);
  EXPECT_EQ(traversal.frames, 5);
  EXPECT_NEAR(traversal.times[0], 1439388276.045321, 1e-5);  // 14:04:36 UTC: the folder's name is British summer time
}

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
  Traversal load() const { return make_dataset("kitti", folder_.path())->load("2011_09_26_drive_0001_sync"); }

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

}  // namespace
}  // namespace citylearn::testing
