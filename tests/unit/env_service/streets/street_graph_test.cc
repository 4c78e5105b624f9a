// SPDX-License-Identifier: Apache-2.0
// Maps of streets from files, and frames that are views of them.
#include "env_service/streets/street_graph.h"

#include <chrono>

#include "env_service/dataset_io/selection.h"
#include "env_service/environment.h"
#include "tests/paths.h"
#include "tests/support/data/layouts.h"
#include "tests/support/data/real_data.h"

namespace citylearn::testing {
namespace {

/// A street to the east and a corner to the north, both 111.2 m:   c
///                                                               a b
class Streets : public ::testing::Test {
 protected:
  Streets() {
    make_file(folder_ / "nodes.txt", "a,180,0,0\nb,180,0,0.001\nc,180,0.001,0.001\n");
    make_file(folder_ / "links.txt", "b,0,c\na,90,b\nb,270,a\nc,180,b\n");  // by place and heading: 1 0 2 3
  }
  /// Writes a table whose row r is r + .5, 7.
  void write_table(const std::string& name, int rows) const {
    std::string text;
    for (int row = 0; row < rows; ++row) text += std::to_string(row) + ".5,7\n";
    make_file(folder_ / (name + ".csv"), text);
  }
  Traversal load(std::optional<StateRule> rule = {}, const Selection& selection = {}) const {
    const auto dataset = make_dataset("plain", folder_.path());
    dataset->walk_by(rule);
    return select(*dataset, "day", selection);
  }
  static std::vector<float> rows_of(const Traversal& traversal) {
    std::vector<float> rows;
    for (int frame = 0; frame < traversal.frames; ++frame) rows.push_back(traversal.feature(frame)[0] - 0.5f);
    return rows;
  }
  Folder folder_;
};

TEST_F(Streets, AMapIsInMetresFromItsFirstPlace) {
  std::vector<std::uint32_t> rows;
  const StreetMap map = StreetGraph::find_in(folder_.path())->map(rows);
  EXPECT_EQ(rows, (std::vector<std::uint32_t>{1, 0, 2, 3}));
  EXPECT_EQ(map.from, (std::vector<std::uint32_t>{0, 1, 1, 2}));
  EXPECT_EQ(map.to, (std::vector<std::uint32_t>{1, 2, 0, 1}));
  EXPECT_EQ(map.heading, (std::vector<float>{90, 0, 270, 180}));
  for (const auto& [place, east, north] : {std::tuple(0, 0.0, 0.0), {1, 0.001, 0.0}, {2, 0.001, 0.001}}) {
    EXPECT_NEAR(map.east[static_cast<std::size_t>(place)], east * kDegree, 0.01);
    EXPECT_NEAR(map.north[static_cast<std::size_t>(place)], north * kDegree, 0.01);
  }
}

TEST_F(Streets, ATableHasAViewPerLinkOrHeadingOrPlace) {
  write_table("day", 4);
  const Traversal links = load();
  EXPECT_EQ(links.rule, StateRule::kStreet);
  EXPECT_EQ(rows_of(links), (std::vector<float>{1, 0, 2, 3}));
  EXPECT_EQ(links.latitude, (std::vector<double>{0, 0, 0, 0.001}));
  EXPECT_EQ(Environment(links, 2).traversal_hash(), links.hash());
  EXPECT_NE(load(StateRule::kLine).hash(), links.hash());
  EXPECT_EQ(load(StateRule::kLine).streets, nullptr);

  write_table("day", 48);
  const Traversal headings = load();
  EXPECT_EQ(headings.rule, StateRule::kStreetFixed);
  EXPECT_EQ(headings.feature(20)[0], 20.5f);
  EXPECT_EQ(load(StateRule::kStreetLearn).rule, StateRule::kStreetLearn);
  EXPECT_TRUE(holds(error_of([&] { load(StateRule::kStreet); }), "day.csv: has 48 frames, where the map has 4 links"));

  write_table("day", 3);
  EXPECT_EQ(rows_of(load()), (std::vector<float>{0, 1, 1, 2}));
  const Traversal places = load(StateRule::kStreetLearn);
  ASSERT_EQ(places.frames, 48);
  EXPECT_EQ(places.feature(20)[0], 1.5f);

  write_table("day", 5);
  EXPECT_EQ(load().streets, nullptr);
  EXPECT_EQ(load().frames, 5);
  EXPECT_TRUE(holds(error_of([&] { load(StateRule::kStreet); }), "or --rule line"));
}

TEST_F(Streets, PicturesAreViewsToo) {
  for (int i = 0; i < 3; ++i) write_grey(folder_ / ("day/" + std::to_string(i) + ".png"), 60 * i);
  const Traversal traversal = load();
  ASSERT_EQ(traversal.frames, 4);
  EXPECT_EQ(picture_of(traversal, 2).at<cv::Vec3b>(0, 0)[0], 60);
  EXPECT_EQ(picture_of(traversal, 3).at<cv::Vec3b>(0, 0)[0], 120);
  std::filesystem::rename(folder_ / "day", folder_ / "other");
  for (const std::string id : {"a", "b", "c"}) write_grey(folder_ / ("day/" + id + ".png"), 9);
  EXPECT_TRUE(holds(error_of([&] { load(); }), "have the names of places"));
}

TEST_F(Streets, AreTakenWholeAndAlignedByIndex) {
  write_table("day", 4);
  write_table("night", 4);
  EXPECT_EQ(rows_of(load({}, {.align = "night"})), (std::vector<float>{1, 0, 2, 3}));
  EXPECT_TRUE(holds(error_of([&] { load({}, {.end = 3}); }), "streets are walked on as a whole"));
  std::filesystem::remove(folder_ / "links.txt");
  EXPECT_TRUE(
      holds(error_of([&] { load(StateRule::kStreet); }), "traversal 'day': has neither a map of streets nor places"));
}

TEST_F(Streets, WrongMapsEndInOneLine) {
  write_table("day", 2);
  const auto told = [&](const std::string& file, const std::string& text) {
    make_file(folder_ / file, text);
    return error_of([&] { load(); });
  };
  make_file(folder_ / "nodes.txt", "a,180,0,0\nb,180,0,0.001\n");
  const auto of_links = [&](const std::string& text) { return told("links.txt", text); };
  EXPECT_TRUE(holds(of_links("a,90,b\nb,270,q\n"), "links.txt:2: id q is not in nodes.txt"));
  EXPECT_TRUE(holds(of_links(std::string("a,90,b\nb,270,a\0x\n", 17)), "links.txt:2: id a?x is not in nodes.txt"));
  EXPECT_TRUE(holds(of_links("a,90,b\nb,inf,a\n"), "links.txt:2: 'inf' is not a heading in degrees"));
  EXPECT_TRUE(holds(of_links("a,90,b\nb,270,a,1\n"), "links.txt:2: not an id, a bearing and an id"));
  EXPECT_TRUE(holds(of_links("a,90,b\n" + std::string(2000, 'x')), "links.txt:2: a line of more than 1023 characters"));
  EXPECT_TRUE(holds(of_links("# one way\n\r\na , 90 , b\r\n"), "links.txt:3: leads to b, which no link leaves"));
  std::string many;
  for (int link = 0; link < 256; ++link) many += "a,90,b\n";
  EXPECT_TRUE(holds(of_links(many), "links.txt:256: more than 255 links at a"));
  many.clear();
  for (int node = 0; node <= 1 << 20; ++node) many += std::to_string(node) + ",0,0,0\n";
  EXPECT_TRUE(holds(told("nodes.txt", many), "nodes.txt:1048577: more than 1048576 places"));
  make_file(folder_ / "nodes.txt", many.substr(0, many.find("5000,")));
  many.clear();
  for (int link = 0; link <= 1 << 20; ++link)
    many += std::to_string(link / 250) + ",0," + std::to_string(link / 250 + 1) + "\n";
  EXPECT_TRUE(holds(of_links(many), "links.txt:1048577: more than 1048576 links"));
  EXPECT_TRUE(holds(told("nodes.txt", "a,180,0\n"), "nodes.txt:1: not a panorama's id, yaw, latitude and longitude"));
  EXPECT_EQ(load(StateRule::kLine).frames, 2) << "a line needs no map";
}

TEST_F(Streets, SayWhatMayBeWrong) {
  // d lies where c does. Nothing leads to e, whose only link heads 200 degrees and leads 135.
  make_file(folder_ / "nodes.txt", "a,0,0,0\nb,0,0,0.001\nc,0,0,0.002\nd,0,0,0.002\ne,0,0.001,0\n");
  make_file(folder_ / "links.txt", "a,90,b\nb,270,a\nb,90,c\nc,270,b\nc,0,d\nd,180,c\ne,200,b\nb,95,d\nd,275,b\n");
  const std::vector<std::string> lines = StreetGraph::find_in(folder_.path())->description();
  ASSERT_EQ(lines.size(), 4u);
  EXPECT_EQ(lines[0], "streets: places 5, links 9, junctions 1, dead ends 1, one-way links 1");
  EXPECT_TRUE(holds(lines[1], "places that cannot be reached from the others, or not left for them: 1, the first e ("));
  EXPECT_TRUE(holds(lines[2], "over 45 degrees off from the positions of their ends: 1, the first "));
  EXPECT_TRUE(holds(lines[2], "links.txt:7 ("));
  EXPECT_TRUE(holds(lines[3], "places at the spot of another: 2, the first c ("));
}

TEST(StreetsOfManhattan, AreReadAndDescribed) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "manhattan-graph");
  if (folder.empty()) GTEST_SKIP() << "no graph of Manhattan";
  const auto begin = std::chrono::steady_clock::now();
  const auto graph = StreetGraph::find_in(folder);
  std::vector<std::uint32_t> rows;
  const StreetMap map = graph->map(rows);
  RecordProperty(
      "map_ms",
      std::to_string(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count()));
  EXPECT_EQ(map.places(), 29641u);
  // Counted in Python before: 1,371 places have more than two links, and 3 others are beside a third by a one-way link.
  const std::vector<std::string> lines = graph->description();
  ASSERT_EQ(lines.size(), 3u);
  EXPECT_EQ(lines[0], "streets: places 29641, links 61319, junctions 1374, dead ends 214, one-way links 3");
  EXPECT_TRUE(holds(lines[1], "of their ends: 1238, the first " + folder + "/links.txt:257 ("));
  EXPECT_TRUE(holds(lines[2], "at the spot of another: 538,"));
}

}  // namespace
}  // namespace citylearn::testing
