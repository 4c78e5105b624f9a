// SPDX-License-Identifier: Apache-2.0
// Oxford RobotCar.
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
  Robotcar() { write_frames("stereo/centre", "stereo.timestamps"); }
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
  for (const char* tags : {"- overcast\n- partial\n", "- partial\n- detour\n- overcast\n"}) {
    make_file(folder_ / "tags/2014-05-14-13-46-12.yaml", tags);
    EXPECT_EQ(make_dataset("oxford_robotcar", folder_.path())->condition(kDrive), "overcast+partial") << tags;
  }
}

TEST_F(Robotcar, RtkBeforeInsAndOdometryLast) {
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
  const std::uint64_t before = load().images->fingerprint(0);
  EXPECT_NE(before, load().images->fingerprint(1));
  EXPECT_EQ(before, load().images->fingerprint(0));
  EXPECT_NE(before, load({{"raw", 0}}).images->fingerprint(0));
  EXPECT_NE(before, load({{"reduce", 2}}).images->fingerprint(0));
  write_picture(drive_ + "/stereo/centre/1400075172000000.png", {1, 2, 3});
  EXPECT_NE(before, load().images->fingerprint(0));
}

TEST_F(Robotcar, TellsWhatIsMissingOrBroken) {
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
  EXPECT_TRUE(holds(error_of([&] { make_dataset("oxford_robotcar", Folder().path())->names(); }), "stereo/centre"));
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

}  // namespace
}  // namespace citylearn::testing
