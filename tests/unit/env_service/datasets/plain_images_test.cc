// SPDX-License-Identifier: Apache-2.0
// Pictures, videos, poses and matches of dataset "plain".
#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class PlainImages : public ::testing::Test {
 protected:
  void write_drive(const std::string& name) const {
    for (int i = 0; i < 12; ++i) write_grey(folder_ / (name + "/img" + std::to_string(i) + ".png"), 20 * i);
  }
  std::unique_ptr<Dataset> plain() const { return make_dataset("plain", folder_.path()); }
  Traversal load(const std::string& name) const { return plain()->load(name); }
  /// Less the folder.
  std::string complaint(const std::string& name) const {
    const std::string line = error_of([&] { load(name); });
    return line.starts_with(folder_.path() + "/") ? line.substr(folder_.path().size() + 1) : line;
  }

  Folder folder_;
};

TEST_F(PlainImages, AFolderATraversal) {
  write_drive("night");
  write_drive("day");
  make_file(folder_ / "feat.csv", "1,2\n3,4\n");
  std::filesystem::create_directory(folder_ / "empty");
  make_file(folder_ / "notes/readme.txt", "x");
  EXPECT_EQ(plain()->names(), (std::vector<std::string>{"day", "feat", "night"}));
  EXPECT_EQ(plain()->correspondence(), Correspondence::kIndex);
  const Traversal day = load("day");
  EXPECT_EQ(day.frames, 12);
  EXPECT_EQ(day.dimension, 0);
  EXPECT_TRUE(day.features.empty());
  EXPECT_EQ(day.condition, "day");
  ASSERT_EQ(day.positions.size(), 12u);
  EXPECT_TRUE(std::isnan(day.positions[3]));
  EXPECT_EQ(day.images->name(2), "day/img2.png");
  EXPECT_EQ(day.images->name(10), "day/img10.png");
  EXPECT_EQ(day.hash(), load("night").hash());
  write_grey(folder_ / "day/img5.png", 7);
  EXPECT_NE(load("day").hash(), day.hash());
}

/// One drive, "day".
struct PlainDrive : PlainImages {
  PlainDrive() { write_drive("day"); }
};

TEST_F(PlainDrive, ATableWithNamedColumnsBesidePicturesIsNoTraversal) {
  make_file(folder_ / "ground_truth.csv", "query,reference\n1,2\n");
  EXPECT_EQ(plain()->names(), std::vector<std::string>{"day"});
  std::filesystem::remove_all(folder_ / "day");
  EXPECT_EQ(plain()->names(), std::vector<std::string>{"ground_truth"}) << "else it is taken for features";
}

TEST_F(PlainImages, AVideoATraversal) {
  ASSERT_TRUE(write_video(folder_ / "drive.avi", 20));
  EXPECT_EQ(plain()->names(), std::vector<std::string>{"drive"});
  const Traversal drive = load("drive");
  EXPECT_EQ(drive.frames, 20);
  EXPECT_EQ(drive.images->name(3), "drive.avi, frame 3");
  ASSERT_EQ(drive.times.size(), 20u);
  EXPECT_NEAR(drive.times[5], 0.2, 1e-6);
  make_file(folder_ / "broken.mp4", "x");
  EXPECT_EQ(
      complaint("broken"),
      "broken.mp4: the video cannot be opened: Invalid data found when processing input (broken, or of a kind that "
      "FFmpeg does not know)");
}

TEST_F(PlainDrive, OneNameTwice) {
  make_file(folder_ / "day.csv", "1\n2\n");
  EXPECT_EQ(error_of([&] { plain()->names(); }),
            folder_.path() + ": traversal 'day' is both day and day.csv (rename or remove one of them)");
  make_file(folder_ / "walk, evening.csv", "1\n2\n");
  std::filesystem::remove(folder_ / "day.csv");
  EXPECT_EQ(error_of([&] { plain()->names(); }),
            folder_.path() + ": 'walk, evening' has a comma, as there is between names (rename it)");
}

TEST_F(PlainDrive, PicturesWhereFoldersShouldBe) {
  EXPECT_EQ(
      error_of([&] { make_dataset("plain", folder_ / "day")->names(); }),
      folder_ / "day: holds pictures itself (--data names the folder above, in which each folder is a traversal)");
  write_grey(folder_ / "one/a.png", 1);
  EXPECT_EQ(complaint("one"), "one: has only one frame, a route needs two");
}

TEST_F(PlainImages, PicturesInAFolderBelow) {
  write_drive("day/run/camera");
  make_file(folder_ / "day/poses.csv", "frame,metres\n0,0\n");
  EXPECT_EQ(plain()->names(), std::vector<std::string>{"day"});
  EXPECT_EQ(load("day").images->name(2), "day/run/camera/img2.png");
  EXPECT_EQ(load("day").positions[0], 0);
  write_drive("day/run/right");
  EXPECT_TRUE(contains(complaint("day"), "day: has pictures in run/camera and in run/right (put all of one drive"));
  make_file(folder_ / "night/0.webp", "x");
  EXPECT_EQ(plain()->names(), (std::vector<std::string>{"day", "night"}));
  EXPECT_TRUE(contains(complaint("night"), "night: has pictures of kinds that are not read: 0.webp (convert"));
}

TEST_F(PlainDrive, PosesInAPlane) {
  make_file(folder_ / "day.poses.csv", "frame,x,y\n2,0,0\n3,3,4\n7,3,10\n");
  Traversal day = load("day");
  EXPECT_TRUE(std::isnan(day.positions[0]));
  EXPECT_EQ(day.positions[2], 0);
  EXPECT_EQ(day.positions[3], 5);
  EXPECT_EQ(day.positions[7], 11);
  EXPECT_TRUE(day.latitude.empty());
  make_file(folder_ / "day.poses.csv", "file,x,y,z,time\nimg2.png,0,0,0,5\nimg3.png,2,3,6,6\n");
  day = load("day");
  EXPECT_EQ(day.positions[3], 7);
  EXPECT_EQ(day.times[3], 6);
  EXPECT_TRUE(std::isnan(day.times[4]));
}

TEST_F(PlainDrive, PosesOnTheEarthAndInMetres) {
  std::string rows = "lat,lon\n";
  for (int i = 0; i < 12; ++i) rows += std::to_string(0.001 * i) + ",7\n";
  make_file(folder_ / "day/poses.csv", rows);
  const Traversal day = load("day");
  EXPECT_NEAR(day.positions[11], 11 * 111.195, 0.1);
  EXPECT_EQ(day.longitude[5], 7);
  // Features may have positions too.
  make_file(folder_ / "feat.csv", "1,2\n3,4\n");
  make_file(folder_ / "feat.poses.csv", "metres\n0\n2.5\n");
  EXPECT_EQ(load("feat").positions, (std::vector<float>{0, 2.5f}));
  EXPECT_EQ(plain()->names(), (std::vector<std::string>{"day", "feat"}));
}

TEST_F(PlainDrive, PosesWithoutAFixAreEmptyOrNan) {
  std::string rows = "lat,lon\n";
  for (int i = 0; i < 12; ++i) rows += i == 4 ? ",\n" : i == 5 ? "nan,nan\n" : std::to_string(50 + 0.001 * i) + ",7\n";
  make_file(folder_ / "day.poses.csv", rows);
  const Traversal day = load("day");
  EXPECT_TRUE(std::isnan(day.positions[4]) && std::isnan(day.latitude[4]) && std::isnan(day.longitude[5]));
  EXPECT_NEAR(day.positions[11], 11 * 111.195, 0.1);
}

TEST_F(PlainDrive, WrongPoses) {
  const auto told = [&](const std::string& text) {
    make_file(folder_ / "day.poses.csv", text);
    return complaint("day");
  };
  EXPECT_EQ(told("a,b\n1,2\n"),
            "day.poses.csv: no column gives places, there are: a, b (its header needs lat,lon or x,y or metres)");
  EXPECT_EQ(told("frame,x\n1,2\n"), "day.poses.csv: no column 'y' (there are: frame, x)");
  EXPECT_EQ(told("frame,lat\n1,2\n"), "day.poses.csv: no column 'lon' (there are: frame, lat)");
  EXPECT_EQ(told("lat,lon\n1,2\n91,2\n"),
            "day.poses.csv:3: not a latitude and a longitude in degrees (leave both empty where there was no fix)");
  EXPECT_EQ(told("frame,metres\n1,2\n1,3\n"), "day.poses.csv:3: a second row for frame 1");
  EXPECT_EQ(told("frame,metres\n12,2\n"), "day.poses.csv:2: frame 12 is beyond day, which has 12 frames");
  EXPECT_EQ(told("frame,metres\n-1,2\n"),
            "day.poses.csv:2: not the number of a frame in column 'frame' (frames begin with 0)");
  EXPECT_EQ(told("file,metres\nimg99.png,2\n"), "day.poses.csv:2: no picture of this name in day");
  EXPECT_EQ(told("lat,lon\n50,1,8,2\n"),
            "day.poses.csv:2: has 4 fields, the header names 2 (write decimals with a point, and no comma within a "
            "field)");
  EXPECT_EQ(told("metres\n1\n2\n\n3\n"),
            "day.poses.csv: has 3 rows, day has 12 frames (write a row for each frame, or name frames in a column "
            "'frame')");
  EXPECT_EQ(told("metres,a,metres\n1,2,3\n"), "day.poses.csv: names two columns 'metres' (rename one)");
  EXPECT_EQ(told(std::string("\xFF\xFEm\0\n\0", 6)), "day.poses.csv: is in UTF-16 (save it in UTF-8)");
  EXPECT_EQ(told("frame,time,metres\n0,5,1\n2,5,3\n1,4,2\n"),
            "day.poses.csv: the time of frame 1 is before that of frame 0 (write rows in the order of frames, or name "
            "frames in a column 'frame')");
  EXPECT_EQ(told("metres\nx\n"), "day.poses.csv:2: 'x' in column 'metres' is not a number");
  make_file(folder_ / "day/poses.csv", "metres\n1\n");
  EXPECT_TRUE(contains(complaint("day"), "remove one of them"));
}

TEST_F(PlainDrive, Matches) {
  write_drive("night");
  EXPECT_NE(error_of([&] { plain()->matches("day", "night"); }), "");
  make_file(folder_ / "matches.csv", "day,night\n0,2\n5,7\n");
  EXPECT_EQ(plain()->correspondence(), Correspondence::kMatches);
  EXPECT_EQ(plain()->names(), (std::vector<std::string>{"day", "night"}));
  const std::vector<std::pair<int, int>> pairs{{0, 2}, {5, 7}}, turned{{2, 0}, {7, 5}};
  EXPECT_EQ(plain()->matches("day", "night"), pairs);
  EXPECT_EQ(plain()->matches("night", "day"), turned);
  EXPECT_EQ(error_of([&] { plain()->matches("day", "dusk"); }),
            folder_ / "matches.csv: no column 'dusk' (its header names traversals, its rows hold their frames)");
  make_file(folder_ / "matches.csv", "day,night\n0,2.5\n");
  EXPECT_EQ(error_of([&] { plain()->matches("day", "night"); }),
            folder_ / "matches.csv:2: not the number of a frame in column 'night' (frames begin with 0)");
}

}  // namespace
}  // namespace citylearn::testing
