// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/paths.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class Nordland : public ::testing::Test {
 protected:
  void write_season(const std::string& name, int first = 1, int frames = 4) const {
    for (int i = 0; i < frames; ++i)
      write_grey(folder_ / (name + "/images-" + std::to_string(100000 + first + i).substr(1) + ".png"), 10 * i);
  }
  std::unique_ptr<Dataset> nordland(const std::map<std::string, double>& parameters = {}) const {
    return make_dataset("nordland", folder_.path(), parameters);
  }
  Folder folder_;
};

TEST_F(Nordland, SeasonsInAnyLetterCase) {
  for (const std::string name : {"Winter", "fall", "SPRING", "summer"}) write_season(name);
  EXPECT_EQ(nordland()->names(), (std::vector<std::string>{"spring", "summer", "fall", "winter"}));
  EXPECT_EQ(nordland()->correspondence(), Correspondence::kIndex);
  const Traversal winter = nordland()->load("winter");
  EXPECT_EQ(winter.condition, "winter");
  EXPECT_EQ(winter.frames, 4);
  EXPECT_EQ(winter.images->name(1), "Winter/images-00002.png");
  EXPECT_EQ(winter.times, (std::vector<double>{1, 2, 3, 4}));
  EXPECT_TRUE(std::isnan(winter.positions[0]));
  EXPECT_EQ(error_of([&] { nordland()->load("dusk"); }),
            folder_.path() + ": no traversal 'dusk' (there are: spring, summer, fall, winter)");
}

TEST_F(Nordland, PartitionedAndInSections) {
  write_season("summer_images_train/section1");
  write_season("summer_images_train/section2");
  write_season("summer_images_test", 1, 3);
  EXPECT_EQ(nordland()->names(), std::vector<std::string>{"summer"});
  const Traversal train = nordland()->load("summer");
  EXPECT_EQ(train.frames, 8);
  EXPECT_EQ(train.images->name(4), "summer_images_train/section2/images-00001.png");
  EXPECT_TRUE(train.times.empty());  // the numbers begin anew
  EXPECT_EQ(nordland({{"test", 1}})->load("summer").frames, 3);
}

TEST_F(Nordland, Films) {
  ASSERT_TRUE(write_video(folder_ / "nordland-Fall.avi", 20, "MJPG", 10));
  std::filesystem::create_directory(folder_ / "winter");
  ASSERT_TRUE(write_video(folder_ / "winter/film.avi", 20));
  EXPECT_EQ(nordland()->names(), (std::vector<std::string>{"fall", "winter"}));
  EXPECT_NEAR(nordland()->load("fall").times[15], 1.5, 1e-6);
  EXPECT_EQ(nordland()->load("winter").images->name(3), "winter/film.avi, frame 3");
  ASSERT_TRUE(write_video(folder_ / "fall-2.avi", 5));
  EXPECT_NE(error_of([&] { nordland()->names(); }).find("both fall-2.avi and nordland-Fall.avi seem to be fall"),
            std::string::npos);
}

TEST_F(Nordland, OtherFolders) {
  write_season("night");
  EXPECT_NE(error_of([&] { nordland()->names(); }).find("is not the dataset nordland"), std::string::npos);
  EXPECT_NE(error_of([&] { make_dataset("nordland", folder_ / "missing")->names(); }), "");
  EXPECT_NE(error_of([&] { make_dataset("nordland")->names(); }), "");
}

TEST_F(Nordland, PosesOfOnesOwnAreNoLog) {
  write_season("summer");
  make_file(folder_ / "summer.poses.csv", "lat,lon\n1,2\n");
  EXPECT_TRUE(nordland()->load("summer").latitude.empty());
  EXPECT_FALSE(nordland()->distinctive());
  make_file(folder_ / "summer_gps.csv", "tid,lat,lon\n5595900,6300000,1000000\n");
  EXPECT_TRUE(nordland()->distinctive());
}

TEST_F(Nordland, GpsLog) {
  write_season("summer", 0, 6);
  // CR alone, degrees times 100,000; a row without sense, and a clock put forward by an hour.
  make_file(folder_ / "gpsData/summer.csv",
            "tid,lat,lon,speed,course,alt\r5595900,6300000,1000000,0,0,0\r6000000,6300100,1000000,0,0,0\r"
            "322.28,-0.36,1.41,0,,\r6000200,6300300,1000000,0,0,0\r7000300,6300400,1000000,0,0,0");
  const Traversal summer = nordland()->load("summer");
  ASSERT_EQ(summer.latitude.size(), 6u);
  const std::vector<double> expected{63, 63.001, 63.002, 63.003, 63.004, 63.004};
  for (std::size_t i = 0; i < 6; ++i) EXPECT_NEAR(summer.latitude[i], expected[i], 1e-9) << i;
  EXPECT_NEAR(summer.positions[3], 333.585, 0.01);
  make_file(folder_ / "gpsData/summer.csv", "tid,lat\r1,2");
  EXPECT_EQ(error_of([&] { nordland()->load("summer"); }),
            folder_ / "gpsData/summer.csv: no column 'lon' (there are: tid, lat)");
}

// A row a second, 11 m further north each, but for what a case says of some rows.
TEST_F(Nordland, ImpossibleFixesAreIgnoredInOneLine) {
  struct Case {
    const char* what;
    int begin, end;    // rows moved
    double north;      // by so many degrees
    const char* told;  // part of the warning; empty: all rows are believed
  };
  write_season("summer", 0, 100);
  for (const Case& one :
       {Case{"rows of another log at the end", 95, 100, 0.2, "5 of 100 GPS fixes are ignored, the first 95 s into"},
        Case{"one wrong fix", 50, 51, 1, "1 of 100 GPS fixes are ignored, the first 50 s into"},
        Case{"wrong until satellites are found", 0, 3, -60, "3 of 100 GPS fixes are ignored, the first 0 s into"},
        Case{"a fix that is off behind a tunnel", 50, 52, 0.002, ""},
        Case{"a log of two parts", 40, 100, 0.2, "traversal 'summer': 22.250 km lie between frame 39"}}) {
    SCOPED_TRACE(one.what);
    std::string table = "tid,lat,lon\n";
    for (int row = 0; row < 100; ++row)
      table += std::to_string(5000000 + 10000 * (row / 60) + 100 * (row % 60)) + "," +
               std::to_string(63 + 0.0001 * row + (row >= one.begin && row < one.end ? one.north : 0)) + ",10\n";
    make_file(folder_ / "gpsData/summer.csv", table);
    const Log log;
    const Traversal summer = nordland()->load("summer");
    EXPECT_TRUE(log.has(one.told)) << log.text();
    EXPECT_EQ(log.lines(), *one.told ? 1 : 0) << log.text();
    const bool ignored = log.has(folder_ / "gpsData/summer.csv: ");
    for (int frame = 0; frame < 100; ++frame)
      EXPECT_LE(std::abs(summer.latitude[frame] - 63), ignored ? 0.011 : 0.3) << frame;
  }
}

TEST_F(Nordland, MatchesByNumber) {
  write_season("summer", 1, 4);
  write_season("winter", 3, 4);
  const std::vector<std::pair<int, int>> pairs{{2, 0}, {3, 1}};
  EXPECT_EQ(nordland()->matches("summer", "winter"), pairs);
}

TEST(NordlandReal, PicturesOfTwoSeasons) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "nordland-64x32");
  if (folder.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const auto dataset = make_dataset("nordland", folder);
  EXPECT_EQ(dataset->names(), (std::vector<std::string>{"summer", "winter"}));
  for (const std::string& name : dataset->names()) {
    const Traversal traversal = dataset->load(name);
    EXPECT_EQ(traversal.frames, 3576);
    EXPECT_EQ(traversal.times[1], 20);  // every tenth second
    for (int frame = 0; frame < traversal.frames; ++frame) ASSERT_EQ(traversal.images->fault(frame), "");
  }
  EXPECT_NE(dataset->load("summer").hash(), dataset->load("winter").hash());
}

TEST(NordlandReal, GpsLogs) {
  const std::string logs = real_data(CITYLEARN_SOURCE_DIR, "formats/deepseqslam/datasets/nordland/gpsData");
  if (logs.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const Folder folder;
  std::filesystem::create_directory_symlink(std::filesystem::absolute(logs), folder / "gpsData");
  for (const std::string name : {"spring", "summer", "fall", "winter"}) {
    // A picture every two hours and a half; the fifth is beyond the ride.
    for (int i = 0; i < 5; ++i) write_grey(folder / (name + "/" + std::to_string(9000 * i) + ".png"), 10);
    const Traversal traversal = make_dataset("nordland", folder.path())->load(name);
    EXPECT_NEAR(traversal.latitude[0], 63.437, 0.001) << name;
    EXPECT_NEAR(traversal.longitude[0], 10.401, 0.001) << name;
    EXPECT_GT(traversal.latitude[3], 66) << name;
    EXPECT_LT(traversal.latitude[3], 67.4) << name;
    EXPECT_GT(traversal.positions[3], 300e3) << name;
    EXPECT_LT(traversal.positions[3], 729e3) << name;
  }
}

// The last 1,122 rows of summer's log are those of winter's, 20 km back.
TEST(NordlandReal, CopiedRowsAreIgnored) {
  const std::string logs = real_data(CITYLEARN_SOURCE_DIR, "formats/deepseqslam/datasets/nordland/gpsData");
  if (logs.empty()) GTEST_SKIP() << "skipped: no recordings; CITYLEARN_DATA names their folder";
  const Folder folder;
  std::filesystem::create_directory_symlink(std::filesystem::absolute(logs), folder / "gpsData");
  for (const auto& [name, warnings] : {std::pair("summer", 1), std::pair("winter", 0)}) {
    for (int i = 0; i < 400; ++i) write_grey(folder / (std::string(name) + "/" + std::to_string(100 * i) + ".png"), 10);
    const Log log;
    const Traversal traversal = make_dataset("nordland", folder.path())->load(name);
    EXPECT_EQ(log.lines(), warnings) << log.text();
    EXPECT_EQ(log.has("summer.csv: 1122 of 33938 GPS fixes are ignored"), warnings == 1) << log.text();
    float longest = 0;
    for (const float metres : traversal.positions)
      if (std::isfinite(metres)) longest = std::max(longest, metres);
    EXPECT_GT(longest, 650e3) << name;  // the ride is 729 km; a frame every 100 s cuts corners
    EXPECT_LT(longest, 729e3) << name;
  }
}

}  // namespace
}  // namespace citylearn::testing
