// SPDX-License-Identifier: Apache-2.0
// Alderley, UQ St Lucia, St Lucia Multiple Times of Day.
#include <cmath>

#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/files/files.h"
#include "tests/support/data/layouts.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

std::string numbered(const std::string& before, int number, std::size_t digits, const std::string& after) {
  std::string text = std::to_string(number);
  return before + text.insert(0, digits - text.size(), '0') + after;
}

TEST(Layout, HolesAreMissingFilesUnlessTheFolderWasThinned) {
  const Folder folder;
  for (int i = 1; i <= 12; ++i)
    if (i != 5) make_file(folder / numbered("Image", i, 5, ".jpg"), "x");
  const std::vector<NumberedFile> whole = numbered_files(folder.path(), {".jpg"});
  ASSERT_EQ(whole.size(), 12u);
  EXPECT_EQ(whole[4].number, 5);
  EXPECT_EQ(whole[4].path, folder / "Image00005.jpg");
  for (int i = 2; i <= 11; ++i)
    if (i % 3) fs::remove(folder / numbered("Image", i, 5, ".jpg"));
  EXPECT_EQ(numbered_files(folder.path(), {".jpg"}).size(), 5u);  // 1 3 6 9 12
  make_file(folder / "other00012.jpg", "x");
  EXPECT_TRUE(holds(error_of([&] { numbered_files(folder.path(), {".jpg"}); }), "other00012.jpg"));
}

TEST(Layout, FormsAndNumbers) {
  EXPECT_TRUE(has_form("180809_1545", "000000_0000"));
  EXPECT_FALSE(has_form("180809_154", "000000_0000"));
  EXPECT_FALSE(has_form("18080x_1545", "000000_0000"));
  EXPECT_EQ(last_number("cam0_image00042"), 42);
  EXPECT_EQ(last_number("image"), -1);
  EXPECT_EQ(last_number("99999999999999999999999"), -1);
}

TEST(Layout, LogsOfPositions) {
  const Folder folder;
  make_file(folder / "a.txt", "latitude,longitude\n27.5,153.0\n0,0\n27.6,153.1,40\n");
  const GpsRows rows = read_gps_rows(folder / "a.txt");
  ASSERT_EQ(rows.latitude.size(), 3u);
  EXPECT_EQ(rows.longitude[2], 153.1);
  EXPECT_TRUE(std::isnan(rows.latitude[1]));
  make_file(folder / "b.txt", "-27.5 153.0\n-27.6\t153.1\n");
  EXPECT_EQ(read_gps_rows(folder / "b.txt").latitude[1], -27.6);
  make_file(folder / "c.txt", "-27.5,153.0\n2730.1,15300.2\n");
  EXPECT_TRUE(holds(error_of([&] { read_gps_rows(folder / "c.txt"); }), "c.txt:2"));
  make_file(folder / "d.txt", "");
  EXPECT_TRUE(holds(error_of([&] { read_gps_rows(folder / "d.txt"); }), "d.txt"));
  // Three rows over five frames.
  const GpsRows wide = spread({{1, 2, 4}, {10, 20, 40}}, 5);
  EXPECT_EQ(wide.latitude, (std::vector<double>{1, 1.5, 2, 3, 4}));
  EXPECT_EQ(wide.longitude, (std::vector<double>{10, 15, 20, 30, 40}));
  // As many as frames, but one: row i is frame i.
  std::vector<double> many(39);
  for (int i = 0; i < 39; ++i) many[static_cast<std::size_t>(i)] = i;
  const GpsRows near = spread({many, many}, 40);
  EXPECT_EQ(near.latitude[38], 38);
  EXPECT_TRUE(std::isnan(near.latitude[39]));
}

class Alderley : public ::testing::Test {
 protected:
  void SetUp() override {
    for (int i = 1; i <= 3; ++i)
      write_picture(folder_ / numbered("FRAMESA/Image", i, 5, ".jpg"), cv::Scalar::all(10 * i));
    for (int i = 1; i <= 4; ++i)
      write_picture(folder_ / numbered("FRAMESB/FRAMESB/Image", i, 5, ".jpg"), cv::Scalar::all(100 + 10 * i));
    make_file(folder_ / "framematches.csv", "1,2\n2,3\n3,4\n");
  }
  Folder folder_;
};

TEST_F(Alderley, ReadsDayAndNight) {
  const auto dataset = make_dataset("alderley", folder_.path());
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"day", "night"}));
  EXPECT_EQ(dataset->correspondence(), Correspondence::kMatches);
  const Traversal night = dataset->load("night"), day = dataset->load("day");
  EXPECT_EQ(night.frames, 3);
  EXPECT_EQ(day.frames, 4);
  EXPECT_EQ(night.condition, "night");
  EXPECT_EQ(night.positions.size(), 3u);
  EXPECT_TRUE(std::isnan(night.positions[0]));
  EXPECT_NEAR(picture_of(night, 2).at<cv::Vec3b>(0, 0)[0], 30, 2);
  EXPECT_NEAR(picture_of(day, 0).at<cv::Vec3b>(0, 0)[0], 110, 2);
  EXPECT_NE(night.images->fingerprint(0), night.images->fingerprint(1));
}

TEST_F(Alderley, MatchesAreOfTheNightThenOfTheDayAndCountFromOne) {
  const auto dataset = make_dataset("alderley", folder_.path());
  EXPECT_EQ(dataset->matches("night", "day"), (std::vector<std::pair<int, int>>{{0, 1}, {1, 2}, {2, 3}}));
  EXPECT_EQ(dataset->matches("day", "night"), (std::vector<std::pair<int, int>>{{1, 0}, {2, 1}, {3, 2}}));
  EXPECT_EQ(dataset->matches("day", "day").size(), 4u);
  // Only every other frame was kept.
  fs::remove(folder_ / "FRAMESA/Image00002.jpg");
  EXPECT_EQ(dataset->matches("night", "day"), (std::vector<std::pair<int, int>>{{0, 1}, {1, 3}}));
  make_file(folder_ / "framematches.csv", "1,2\n2,three\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->matches("night", "day"); }), "framematches.csv:2"));
  make_file(folder_ / "framematches.csv", "1,2\n2,2.5\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->matches("night", "day"); }), "framematches.csv:2"));
  make_file(folder_ / "framematches.csv", "100,200\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->matches("night", "day"); }), "framematches.csv"));
  fs::remove(folder_ / "framematches.csv");
  EXPECT_TRUE(holds(error_of([&] { dataset->matches("night", "day"); }), "framematches.csv"));
}

TEST_F(Alderley, TellsWhatIsMissingOrBroken) {
  for (int i = 5; i <= 20; ++i)
    write_picture(folder_ / numbered("FRAMESB/FRAMESB/Image", i, 5, ".jpg"), cv::Scalar::all(5 * i));
  fs::remove(folder_ / "FRAMESB/FRAMESB/Image00007.jpg");
  make_file(folder_ / "FRAMESB/FRAMESB/Image00008.jpg", "cut off");
  const Traversal day = make_dataset("alderley", folder_.path())->load("day");
  EXPECT_EQ(day.frames, 20);
  EXPECT_NE(day.images->fault(6), "");
  EXPECT_NE(day.images->fault(7), "");
  EXPECT_TRUE(holds(day.images->name(6), "Image00007.jpg"));
  const Folder other;
  EXPECT_TRUE(holds(error_of([&] { make_dataset("alderley", other.path())->names(); }), "FRAMESA"));
}

class UqStLucia : public ::testing::Test {
 protected:
  void SetUp() override {
    std::string log = "sec usec flag width height sec usec flag width height cam0 cam1\n";
    for (int i = 0; i < 3; ++i) {
      cv::Mat raw = cv::Mat::zeros(16, 16, CV_8UC1);  // red light: the pixels of the second row's first column
      for (int y = 1; y < 16; y += 2)
        for (int x = 0; x < 16; x += 2) raw.at<uchar>(y, x) = static_cast<uchar>(100 + 50 * i);
      fs::create_directories(folder_ / "101215_153851_MultiCamera0");
      for (const std::string camera : {"cam0", "cam1"})
        ASSERT_TRUE(
            cv::imwrite(folder_ / numbered("101215_153851_MultiCamera0/" + camera + "_image", i, 5, ".bmp"), raw));
      const std::string time = "1292391531 " + std::to_string(100000 * i);
      log += time + " 0 640 480 1292391532 " + std::to_string(100000 * i) + " 0 640 480 " +
             numbered("101215_153851_MultiCamera0/cam0_image", i, 5, ".bmp ") +
             numbered("101215_153851_MultiCamera0/cam1_image", i, 5, ".bmp\n");
    }
    make_file(folder_ / "101215_153851_MultiCamera0.log", log);
  }
  Traversal load(const std::map<std::string, double>& parameters = {}) const {
    return make_dataset("st_lucia", folder_.path(), parameters)->load("101215_153851");
  }
  Folder folder_;
};

TEST_F(UqStLucia, ReadsTheDrive) {
  // 0.001 degrees south in 0.2 s; and the same with longitude first.
  for (const std::string ins :
       {"1292391531 0 -27.5 153.0 30 30 0 0 0 0 0 0\n1292391531 200000 -27.501 153.0 30 30 0 0 0 0 0 0\n",
        "1292391531 0 153.0 -27.5 30 30 0 0 0 0 0 0\n1292391531 200000 153.0 -27.501 30 30 0 0 0 0 0 0\n"}) {
    make_file(folder_ / "101215_153851_Ins0.log", ins);
    const Traversal traversal = load();
    ASSERT_EQ(traversal.frames, 3);
    EXPECT_NEAR(traversal.times[1], 1292391531.1, 1e-6);
    EXPECT_NEAR(traversal.latitude[1], -27.5005, 1e-6);
    EXPECT_NEAR(traversal.longitude[1], 153, 1e-9);
    EXPECT_NEAR(traversal.positions[2], 0.001 * kDegree, 0.05);
  }
  EXPECT_EQ(make_dataset("st_lucia", folder_.path())->names(), std::vector<std::string>{"101215_153851"});
  EXPECT_NEAR(load({{"camera", 1}}).times[1], 1292391532.1, 1e-6);
  EXPECT_EQ(picture_of(load(), 1).at<cv::Vec3b>(8, 8), cv::Vec3b(0, 0, 150));
  EXPECT_EQ(picture_of(load({{"raw", 0}}), 1).at<cv::Vec3b>(9, 8), cv::Vec3b(150, 150, 150));
  EXPECT_NE(load().images->fingerprint(1), load({{"raw", 0}}).images->fingerprint(1));
}

TEST_F(UqStLucia, FindsPicturesThatBecamePng) {
  fs::remove(folder_ / "101215_153851_MultiCamera0/cam0_image00001.bmp");
  write_picture(folder_ / "101215_153851_MultiCamera0/cam0_image00001.png");
  EXPECT_EQ(load().images->fault(1), "");
}

TEST_F(UqStLucia, TellsWhatIsMissingOrBroken) {
  EXPECT_TRUE(std::isnan(load().positions[0]));  // no Ins0.log
  fs::remove(folder_ / "101215_153851_MultiCamera0/cam0_image00001.bmp");
  make_file(folder_ / "101215_153851_MultiCamera0/cam0_image00002.bmp", "BM");
  EXPECT_NE(load().images->fault(1), "");
  EXPECT_NE(load().images->fault(2), "");
  EXPECT_TRUE(holds(load().images->name(1), "cam0_image00001.bmp"));
  make_file(folder_ / "101215_153851_Ins0.log", "1292391531 0 -27.5 153.0\n1292391531 200000 -127.5 153.0\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "Ins0.log:2"));
  make_file(folder_ / "101215_153851_MultiCamera0.log", "header\n1 2 3\n");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "MultiCamera0.log:2"));
  fs::remove(folder_ / "101215_153851_MultiCamera0.log");
  EXPECT_TRUE(holds(error_of([&] { load(); }), "MultiCamera0.log"));
  const Folder other;
  EXPECT_TRUE(holds(error_of([&] { make_dataset("st_lucia", other.path())->names(); }), "MultiCamera0"));
}

TEST(StLuciaMultipleTimes, ReadsVideosWithARowOfGpsAFrame) {
  const Folder folder;
  write_avi(folder / "190809_0845/webcam_video.avi", 4, 15);
  // As published, without the minus of the southern latitude.
  make_file(folder / "190809_0845/fGPS.txt", "27.500,153.0\n27.501,153.0\n0,0\n27.503,153.0\n");
  write_avi(folder / "180809_1545/webcam_video.avi", 3, 15);
  const auto dataset = make_dataset("st_lucia_multiple_times", folder.path());
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"180809_1545", "190809_0845"}));
  EXPECT_EQ(dataset->condition("190809_0845"), "08:45");
  EXPECT_EQ(dataset->correspondence(), Correspondence::kGps);
  const Traversal traversal = dataset->load("190809_0845");
  ASSERT_EQ(traversal.frames, 4);
  EXPECT_EQ(traversal.condition, "08:45");
  EXPECT_DOUBLE_EQ(traversal.latitude[1], -27.501);
  EXPECT_DOUBLE_EQ(traversal.longitude[1], 153.0);
  EXPECT_TRUE(std::isnan(traversal.positions[2]));
  EXPECT_NEAR(traversal.positions[3], 0.003 * kDegree, 0.05);
  EXPECT_NEAR(traversal.times[3], 0.2, 1e-9);
  EXPECT_NEAR(picture_of(traversal, 3).at<cv::Vec3b>(8, 8)[1], 60, 3);
  EXPECT_NE(traversal.images->fingerprint(0), dataset->load("180809_1545").images->fingerprint(0));
  EXPECT_TRUE(std::isnan(dataset->load("180809_1545").positions[0]));  // no log
}

TEST(StLuciaMultipleTimes, ThinnedPicturesTakeTheRowOfTheirNumber) {
  const Folder folder;
  for (const int number : {1, 4, 9}) write_picture(folder / numbered("180809_1545/", number, 7, ".png"));
  std::string log;
  for (int row = 0; row < 10; ++row) log += "27." + std::to_string(500 + row) + ",153.0\n";
  make_file(folder / "180809_1545/fGPS.txt", log);
  const Traversal traversal = make_dataset("st_lucia_multiple_times", folder.path())->load("180809_1545");
  ASSERT_EQ(traversal.frames, 3);
  EXPECT_DOUBLE_EQ(traversal.latitude[0], -27.501);
  EXPECT_DOUBLE_EQ(traversal.latitude[2], -27.509);
  EXPECT_NEAR(traversal.positions[1], 0.003 * kDegree, 0.05);
}

TEST(StLuciaMultipleTimes, TellsWhatIsMissingOrBroken) {
  const Folder folder;
  EXPECT_TRUE(
      holds(error_of([&] { make_dataset("st_lucia_multiple_times", folder.path())->names(); }), "<ddmmyy_hhmm>"));
  fs::create_directories(folder / "180809_1545");
  const auto dataset = make_dataset("st_lucia_multiple_times", folder.path());
  EXPECT_TRUE(holds(error_of([&] { dataset->load("180809_1545"); }), "180809_1545: has neither a video nor pictures"));
  make_file(folder / "180809_1545/webcam_video.avi", "not a video");
  EXPECT_TRUE(holds(error_of([&] { dataset->load("180809_1545"); }), "webcam_video.avi"));
  write_avi(folder / "180809_1545/webcam_video.avi", 3, 15);
  make_file(folder / "180809_1545/fGPS.txt", "27.5,153.0\n27.5;153.0\n27.5,153.0\n");
  EXPECT_TRUE(holds(error_of([&] { dataset->load("180809_1545"); }), "fGPS.txt:2"));
}

}  // namespace
}  // namespace citylearn::testing
