// SPDX-License-Identifier: Apache-2.0
// Folders, tables and geometry that readers of datasets share.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "core/files/files.h"
#include "core/util/random.h"
#include "env_service/files/files.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"
#include "env_service/geometry/plane.h"
#include "tests/support/data/pictures.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(Files, ListsInNaturalOrder) {
  const Folder folder;
  for (const std::string name : {"img10.PNG", "img2.png", "img1.png", "img02.jpg", ".img3.png", "notes.txt", ".png"})
    make_file(folder / name, "x");
  std::filesystem::create_directory(folder / "img4.png");
  EXPECT_EQ(files_in(folder.path(), image_suffixes()),
            (std::vector<std::string>{"img1.png", "img02.jpg", "img2.png", "img10.PNG"}));
  EXPECT_EQ(folders_in(folder.path()), std::vector<std::string>{"img4.png"});
  EXPECT_EQ(error_of([&] { files_in(folder / "no", {".png"}); }), folder / "no: No such file or directory");
}

TEST(Files, NamesOfLongNumbers) {
  const Folder folder;
  const std::string big = "123456789012345678901234567890";
  for (const std::string& name : {big + "1.png", big + ".png", std::string("9.png")}) make_file(folder / name, "x");
  EXPECT_EQ(files_in(folder.path(), {".png"}), (std::vector<std::string>{"9.png", big + ".png", big + "1.png"}));
}

TEST(Files, PathsBelowAFolder) {
  for (const std::string root : {"/a/b", "/a/b/", "/a/b//"}) {
    EXPECT_EQ(path_below("/a/b/c/d.png", root), "c/d.png");
    EXPECT_EQ(path_below(root + "/d.png", root), "d.png");
    EXPECT_EQ(path_below("/a/bc/d.png", root), "/a/bc/d.png");
    EXPECT_EQ(path_below("/a", root), "/a");
  }
  EXPECT_EQ(path_below("/a/b", ""), "/a/b");
  EXPECT_EQ(path_below("/a/b", "/"), "a/b");
}

TEST(Files, ReadsAWholeFile) {
  const Folder folder;
  const std::string text = std::string(100'000, 'a') + '\0' + "b";
  make_file(folder / "x", text);
  EXPECT_EQ(read_file(folder / "x"), text);
  EXPECT_EQ(error_of([&] { read_file(folder / "x", 1000); }), folder / "x: is larger than 1000 bytes");
  EXPECT_EQ(error_of([&] { read_file(folder / "y"); }), folder / "y: No such file or directory");
  EXPECT_EQ(error_of([&] { read_file(folder.path()); }), folder.path() + ": is a folder, not a file");
}

TEST(Table, AnyLineEndsAndAHeader) {
  const Folder folder;
  for (const std::string end : {"\n", "\r\n", "\r"}) {
    make_file(folder / "t.csv", "\xEF\xBB\xBF# made by hand" + end + "time, x ,name" + end + end + "1,+2.5, a b " +
                                    end + "-3e1,4,c" + end);
    const TextTable table(folder / "t.csv", {});
    ASSERT_EQ(table.rows(), 2);
    EXPECT_EQ(table.columns(0), 3);
    EXPECT_TRUE(table.has("x"));
    EXPECT_FALSE(table.has("y"));
    EXPECT_EQ(table.number(0, "x"), 2.5);
    EXPECT_EQ(table.text(0, "name"), "a b");
    EXPECT_EQ(table.number(1, 0), -30);
    EXPECT_EQ(error_of([&] { table.fail(1, "odd", "mend it"); }), folder / "t.csv:5: odd (mend it)");
  }
}

TEST(Table, RunsOfBlanksSeparate) {
  const Folder folder;
  make_file(folder / "poses.txt", "  1  2\t3 \n4 5 6");
  const TextTable table(folder / "poses.txt", {' ', false});
  ASSERT_EQ(table.rows(), 2);
  EXPECT_EQ(table.columns(0), 3);
  EXPECT_EQ(table.number(0, 1), 2);
  EXPECT_EQ(table.number(1, 2), 6);
}

TEST(Table, NamesFileLineAndColumnOfWhatIsWrong) {
  const Folder folder;
  const std::string path = folder / "t.csv";
  make_file(path, "a,b\n1,x\n2\n3,\n4,nan\n5,1e999\n");
  const TextTable table(path, {});
  EXPECT_EQ(error_of([&] { table.number(0, "b"); }), path + ":2: 'x' in column 'b' is not a number");
  EXPECT_EQ(error_of([&] { table.number(1, "b"); }), path + ":3: nothing in column 'b'");
  EXPECT_EQ(error_of([&] { table.number(2, 1); }), path + ":4: nothing in column 'b'");
  EXPECT_EQ(error_of([&] { table.number(3, "b"); }), path + ":5: a number that is not finite in column 'b'");
  EXPECT_EQ(error_of([&] { table.number(4, "b"); }), path + ":6: a number that is not finite in column 'b'");
  EXPECT_EQ(error_of([&] { table.number(0, "c"); }), path + ": no column 'c' (there are: a, b)");
  EXPECT_EQ(error_of([&] { table.text(0, 2); }), path + ":2: no column 3, there are 2");
  make_file(path, "");
  EXPECT_EQ(error_of([&] { TextTable(path, {}); }), path + ": is empty (its first line should name the columns)");
  EXPECT_EQ(TextTable(path, {',', false}).rows(), 0);
}

TEST(Geometry, MetresOfADegree) {
  // A degree of a great circle on the sphere of the mean radius.
  const double degree = 6'371'008.8 * 3.14159265358979 / 180;
  EXPECT_NEAR(metres_between(0, 10, 1, 10), degree, 1e-6);
  EXPECT_NEAR(metres_between(60, 179.5, 60, -179.5), degree / 2, 20);  // over the date line; half a degree's width
  EXPECT_EQ(metres_between(12, 34, 12, 34), 0);
  const std::vector<float> along = metres_along({0, kNan, 0.001, 0.001}, {0, 0, 0, 0.001});
  EXPECT_EQ(along[0], 0);
  EXPECT_TRUE(std::isnan(along[1]));
  EXPECT_NEAR(along[2], degree / 1000, 1e-3);
  EXPECT_NEAR(along[3], 2 * degree / 1000, 1e-3);
}

TEST(Geometry, MetresInAPlane) {
  const std::vector<float> along = metres_along_plane({kNan, 0, 3, kNan, 3}, {0, 0, 4, 4, 5});
  EXPECT_TRUE(std::isnan(along[0]));
  EXPECT_EQ(along[1], 0);
  EXPECT_EQ(along[2], 5);
  EXPECT_TRUE(std::isnan(along[3]));
  EXPECT_EQ(along[4], 6);
}

// 20 places 5 m apart, then a stand of 200 places, then 20 places on.
TEST(Geometry, AVehicleThatStandsDoesNotGetOn) {
  const double degree = 6'371'008.8 * 3.14159265358979 / 180;
  for (const double noise : {0.0, 0.3, 1.5}) {
    std::vector<double> north, east;
    Random random(7);
    const auto off = [&] { return noise * (static_cast<double>(random.below(2001)) / 500 - 2); };
    const auto add = [&](double metres) {
      north.push_back(50 + (metres + off()) / degree);
      east.push_back(8 + off() / (degree * std::cos(50 * M_PI / 180)));
    };
    for (int i = 0; i < 20; ++i) add(5.0 * i);
    for (int i = 0; i < 200; ++i) add(95);
    for (int i = 20; i < 40; ++i) add(5.0 * i);
    // Noise of up to twice that adds to steps of 5 m too; standing, it would add 600 m.
    EXPECT_NEAR(metres_along(north, east).back(), 195, 1 + 30 * noise) << noise;
    EXPECT_NEAR(metres_along(north, east)[119], 95, 1 + 15 * noise) << noise;
    for (double& metres : north) metres = (metres - 50) * degree;
    for (double& metres : east) metres = (metres - 8) * degree * std::cos(50 * M_PI / 180);
    EXPECT_NEAR(metres_along_plane(north, east).back(), 195, 1 + 30 * noise) << noise;
  }
  // Slow circles and turns on the spot are no noise: all of 2 m x 100 and 100 x 0.1 m count.
  std::vector<double> x, y;
  for (int i = 0; i <= 100; ++i) {
    x.push_back(2 * std::cos(i));
    y.push_back(2 * std::sin(i));
  }
  EXPECT_NEAR(metres_along_plane(x, y).back(), 100 * 4 * std::sin(0.5), 1e-3);
  x.assign(101, 0);
  for (int i = 0; i <= 100; ++i) x[static_cast<std::size_t>(i)] = i % 2 ? 0.1 : 0;
  EXPECT_NEAR(metres_along_plane(x, std::vector<double>(101)).back(), 10, 1e-3);
}

TEST(Geometry, PlacesThatAreNearWhereverTheyAre) {
  std::vector<Grid::Near> near;
  for (const auto& [north, east, other_north, other_east] :
       {std::array{-16.8, 179.99999, -16.8, -179.99999}, std::array{89.99999, 0.0, 89.99999, 180.0},
        std::array{70.0, 20.0, 70.00001, 20.00002}, std::array{0.0, -0.00001, 0.0, 0.00001}}) {
    Grid grid(3);
    grid.add(on_earth(north, east), 7);
    grid.near(on_earth(other_north, other_east), near);
    ASSERT_EQ(near.size(), 1u) << north;
    EXPECT_NEAR(near[0].metres, metres_between(north, east, other_north, other_east), 1e-6);
  }
}

TEST(Geometry, InterpolatesBetweenSamples) {
  EXPECT_EQ(interpolate_longitude({0, 2, 4}, {179, -179, 179}, {0, 1, 2, 3}, 0),
            (std::vector<double>{179, 180, -179, 180}));

  const std::vector<double> found =
      interpolate({1, 2, 2, 4}, {10, 20, 30, 50}, {0, 0.5, 1, 1.5, 2, 3, 4, 4.5, 5.1, kNan}, 1);
  const std::vector<double> expected{10, 10, 10, 15, 30, 40, 50, 50};
  for (std::size_t i = 0; i < expected.size(); ++i) EXPECT_DOUBLE_EQ(found[i], expected[i]) << i;
  EXPECT_TRUE(std::isnan(found[8]));
  EXPECT_TRUE(std::isnan(found[9]));
  EXPECT_TRUE(std::isnan(interpolate({}, {}, {1}, 1)[0]));
  EXPECT_EQ(interpolate({1, 2}, {5, kNan}, {1}, 1)[0], 5);
}

}  // namespace
}  // namespace citylearn::testing
