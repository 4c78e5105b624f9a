// SPDX-License-Identifier: Apache-2.0
// StreetLearn as it is published: a LevelDB of protocol buffers, here by LevelDB itself and the schema's field numbers.
#include <leveldb/db.h>

#include <chrono>
#include <fstream>
#include <set>

#include "env_service/geometry/geometry.h"
#include "env_service/streets/street_graph.h"
#include "tests/paths.h"
#include "tests/support/data/layouts.h"
#include "tests/support/data/proto.h"
#include "tests/support/data/real_data.h"

namespace citylearn::testing {
namespace {

namespace fs = std::filesystem;

/// Columns of 20 degrees: grey 12 * sector, counted clockwise from north, of a panorama whose middle looks to
/// `heading`.
std::string panorama_jpeg(double heading) {
  cv::Mat panorama(180, 360, CV_8UC3);
  for (int x = 0; x < 360; ++x) {
    const int sector = static_cast<int>(heading + x - 180 + 360) % 360 / 20;
    panorama.col(x) = cv::Scalar::all(12 * sector);
  }
  std::vector<uchar> bytes;
  cv::imencode(".jpg", panorama, bytes);
  return {bytes.begin(), bytes.end()};
}
Proto coordinates(double latitude, double longitude) { return Proto().wide(1, latitude).wide(2, longitude); }
Proto pano(const std::string& id, const Proto& coords, double heading) {
  return Proto().text(1, id).text(3, "Street").message(9, coords).wide(10, 12.5).wide(13, heading).text(14, "2026-06");
}
Proto connection(const std::string& id, const std::vector<std::string>& neighbors) {
  Proto message = Proto().text(1, id).number(2, 300);
  for (const std::string& neighbor : neighbors) message.text(3, neighbor);
  return message;
}

std::map<std::string, std::string> bytes_of(const fs::path& folder) {
  std::map<std::string, std::string> files;
  for (const auto& entry : fs::directory_iterator(folder)) {
    std::ifstream in(entry.path(), std::ios::binary);
    files[entry.path().filename()].assign(std::istreambuf_iterator<char>(in), {});
  }
  return files;
}

/// a, b and c lie on a street going east, b2 where b does; d is north of c. One-way is d -> a.
class StreetLearnPublished : public ::testing::Test {
 protected:
  static Proto places() {
    Proto graph;
    graph.message(1, coordinates(0, 0)).message(2, coordinates(1, 1));
    for (const auto& [id, place] : kPlaces) graph.message(5, pano(id, coordinates(place[0], place[1]), place[2]));
    return graph;
  }
  static Proto map() {
    Proto graph = places();
    return graph.message(3, connection("a", {"b"}))
        .message(3, connection("b", {"a", "c", "b2"}))
        .message(3, connection("b2", {"b"}))
        .message(3, connection("c", {"b", "d"}))
        .message(3, connection("d", {"c", "a"}));
  }
  void write(const std::map<std::string, std::string>& values, bool compact = false) const {
    leveldb::DB* open = nullptr;
    leveldb::Options options;
    options.create_if_missing = true;
    ASSERT_TRUE(leveldb::DB::Open(options, folder_.path(), &open).ok());
    const std::unique_ptr<leveldb::DB> db(open);
    for (const auto& [key, value] : values) ASSERT_TRUE(db->Put({}, key, value).ok());
    if (compact) db->CompactRange(nullptr, nullptr);
  }
  void write_all(bool compact) const {
    std::map<std::string, std::string> values{{"panos_connectivity", map().bytes()}};
    for (const auto& [id, place] : kPlaces)
      values[id] = pano(id, coordinates(place[0], place[1]), place[2]).text(16, panorama_jpeg(place[2])).bytes();
    write(values, compact);
  }
  std::string error_of_map(const Proto& graph) const {
    write({{"panos_connectivity", graph.bytes()}});
    return error_of([&] { dataset()->names(); });
  }
  std::unique_ptr<Dataset> dataset() const { return make_dataset("streetlearn", folder_.path(), {{"size", 84}}); }

  static inline const std::map<std::string, std::array<double, 3>> kPlaces{{"a", {0, 0, 180}},
                                                                           {"b", {0, 0.001, 50}},
                                                                           {"b2", {0, 0.001, 70}},
                                                                           {"c", {0, 0.002, -90}},
                                                                           {"d", {0.001, 0.002, 0}}};
  Folder folder_;
};

TEST_F(StreetLearnPublished, APanoramaOfTheCityIsReadWhenItIsSeen) {
  write_all(true);
  write({{"c", "cut short"}});
  const auto city = dataset();
  city->walk_by(StateRule::kStreet);
  const Traversal streets = city->load("streets");
  // By place and heading: a-b, then of b: b2 at its spot (50, its yaw), c and a; b2-b, c-d, c-b, d-a, d-c.
  ASSERT_EQ(streets.frames, 9);
  EXPECT_EQ(streets.images->fault(5), "");
  EXPECT_NEAR(picture_of(streets, 2).at<cv::Vec3b>(60, 42)[0], 48, 3) << "east";
  Bytes bytes;
  EXPECT_TRUE(holds(error_of([&] { streets.images->read(5, bytes); }), "/c: "));
}

TEST_F(StreetLearnPublished, WalksRoutesAndLeavesTheFolderAsItIs) {
  for (const bool compact : {false, true}) {  // from the log of the last writer, and from a table
    write_all(compact);
    make_file(folder_ / "routes.txt", "corner,a,d\nspot,a,b2,b\n");
    fs::permissions(folder_.path(), fs::perms::owner_read | fs::perms::owner_exec);
    const auto before = bytes_of(folder_.path());
    EXPECT_EQ(recognised(folder_.path()), std::vector<std::string>{"streetlearn"});
    const Traversal corner = dataset()->load("corner"), spot = dataset()->load("spot");  // two readers at once
    ASSERT_EQ(corner.frames, 4);                                                         // a b c d
    EXPECT_NEAR(corner.positions[3], 0.003 * kDegree, 0.05);
    EXPECT_EQ(corner.latitude[3], 0.001);
    // It looks east, sector 4 (80 to 100 degrees), then north and on: between sectors 17 and 0.
    for (const int frame : {0, 1}) EXPECT_NEAR(picture_of(corner, frame).at<cv::Vec3b>(60, 42)[0], 48, 3) << frame;
    for (const int frame : {2, 3}) {
      EXPECT_NEAR(picture_of(corner, frame).at<cv::Vec3b>(60, 38)[0], 204, 4) << frame;
      EXPECT_NEAR(picture_of(corner, frame).at<cv::Vec3b>(60, 46)[0], 0, 4) << frame;
    }
    ASSERT_EQ(spot.frames, 4);  // a b b2 b
    EXPECT_EQ(spot.positions[1], spot.positions[3]);
    // Links between places at one spot have the yaw of the place that they leave: 50 (sector 2) and 70 (sector 3).
    EXPECT_NEAR(picture_of(spot, 1).at<cv::Vec3b>(60, 42)[0], 24, 3);
    EXPECT_NEAR(picture_of(spot, 2).at<cv::Vec3b>(60, 42)[0], 36, 3);
    EXPECT_EQ(corner.images->name(0), "panorama a");
    EXPECT_EQ(corner.images->fault(0), "");
    EXPECT_NE(corner.images->fingerprint(0), corner.images->fingerprint(1));
    EXPECT_EQ(bytes_of(folder_.path()), before);
    fs::permissions(folder_.path(), fs::perms::owner_all);
  }
}

TEST_F(StreetLearnPublished, NamesWhatIsWrongWithAMap) {
  const auto wrong = [&](const Proto& part) { return error_of_map(places().message(3, part)); };
  EXPECT_TRUE(holds(wrong(connection("a", {"z"})), "panos_connectivity: links a with panorama z, which"));
  EXPECT_TRUE(holds(wrong(connection("y", {"a"})), "connects panorama y, which"));
  EXPECT_TRUE(holds(wrong(connection("b", {"a", "b"})), "b is linked with itself"));
  EXPECT_TRUE(holds(wrong(connection("a", std::vector<std::string>(256, "b"))), "more than 255 links at a"));
  EXPECT_TRUE(holds(error_of_map(places()), "links no two panoramas"));
  const double nan = std::nan(""), infinite = std::numeric_limits<double>::infinity();
  const auto described = [&](const Proto& place) { return error_of_map(map().message(5, place)); };
  EXPECT_TRUE(holds(described(pano("e", coordinates(0, 0), nan)), "the heading of e is not a finite number"));
  EXPECT_TRUE(holds(described(pano("e", coordinates(infinite, 0), 0)), "the coordinates of e"));
  EXPECT_TRUE(holds(described(pano("e", Proto(), 0)), "the coordinates of e"));
  EXPECT_TRUE(holds(described(pano("a", coordinates(0, 0), 0)), "a second row for this id, a"));
  EXPECT_TRUE(holds(described(pano("", coordinates(0, 0), 0)), "an id that has not 1 to 64 characters"));
  EXPECT_TRUE(holds(described(Proto().text(1, "e").text(9, "\x09xx")), "cut short"));
  EXPECT_TRUE(holds(described(pano("e", coordinates(0, 0), 0).real(13, 1)), "the heading of e is not"));

  const std::string whole = map().bytes();
  write({{"panos_connectivity", whole.substr(0, whole.size() - 1)}});
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "panos_connectivity: is not the message of StreetLearn"));
  std::string many;  // 1,048,577 places of an id and coordinates each, by number
  for (int place = 0; place <= 1'048'576; ++place)
    many += Proto().message(5, Proto().text(1, std::to_string(place)).message(9, coordinates(0, 0))).bytes();
  write({{"panos_connectivity", many}});
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "more than 1048576 places"));
}

TEST_F(StreetLearnPublished, NamesWhatIsDamaged) {
  write_all(true);
  write(
      {{"b", pano("b", coordinates(0, 0.001), 50).bytes()}, {"c", Proto().text(16, "GIF89a").bytes()}, {"d", "\x82"}});
  make_file(folder_ / "routes.txt", "corner,a,d\n");
  const Traversal corner = dataset()->load("corner");
  EXPECT_EQ(corner.images->fault(0), "");
  EXPECT_TRUE(holds(corner.images->fault(1), "/b: has no picture"));
  EXPECT_TRUE(holds(corner.images->fault(2), "/c: has a picture that is not a JPEG"));
  EXPECT_TRUE(holds(corner.images->fault(3), "/d: is not the message of StreetLearn"));
  Bytes bytes;
  EXPECT_TRUE(holds(error_of([&] { corner.images->read(1, bytes); }), "/b: has no picture"));

  for (const auto& entry : fs::directory_iterator(folder_.path()))
    if (entry.path().extension() == ".ldb") fs::resize_file(entry.path(), fs::file_size(entry.path()) - 7);
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "key panos_connectivity cannot be read"));
  EXPECT_TRUE(recognised(folder_.path()).empty());
  EXPECT_TRUE(holds(unknown_traversal("", folder_.path(), {}).what(), "key panos_connectivity cannot be read"));
  for (const auto& entry : fs::directory_iterator(folder_.path()))
    if (entry.path().extension() == ".ldb") fs::remove(entry.path());
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "cannot be read as a LevelDB: Corruption: 1 missing files"));
  make_file(folder_ / "CURRENT", "MANIFEST-999999\n");
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "cannot be read as a LevelDB"));
}

TEST_F(StreetLearnPublished, IsFoundInAFolderOfItsOwnAndWithoutItsManifestsName) {
  write_all(true);
  const Folder above;
  fs::copy(folder_.path(), above / "city", fs::copy_options::recursive);
  const auto told = [&] { return std::string(unknown_traversal("", above.path(), {}).what()); };
  EXPECT_TRUE(
      holds(told(), "no traversals found: it has StreetLearn in a folder of its own (--data names that folder)"));
  fs::remove(above / "city/CURRENT");
  EXPECT_TRUE(holds(told(), "city: cannot be read as a LevelDB"));
}

TEST_F(StreetLearnPublished, RefusesOtherDatabases) {
  write({{"weather", "rain"}});
  EXPECT_TRUE(holds(error_of([&] { dataset()->names(); }), "has no key panos_connectivity"));
}

TEST(StreetLearnSample, WalksAsItsReadmeSays) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "formats/drives-2026/streetlearn");
  if (folder.empty()) GTEST_SKIP() << "the sample of StreetLearn is not there";
  const auto before = bytes_of(folder);
  const LevelDb database(folder);
  const StreetGraph graph = StreetGraph::from_leveldb(database);
  const auto place = [&](const std::string& name) { return graph.find(name + std::string(22 - name.size(), '_')); };
  ASSERT_EQ(graph.places().size(), 14u);
  const auto links = [&](const std::string& name) { return graph.places()[place(name)].links; };
  EXPECT_EQ(links("C").size(), 5u);
  ASSERT_EQ(links("C2").size(), 1u);
  EXPECT_EQ(links("C2")[0].metres, 0);
  EXPECT_EQ(links("C2")[0].heading, 30);
  ASSERT_EQ(links("W3").size(), 1u);
  EXPECT_NEAR(links("W3")[0].heading, 90, 0.01);
  EXPECT_NEAR(links("W3")[0].metres, 10, 0.05);
  EXPECT_EQ(graph.walk({place("W3"), place("N3")}, "").size(), 7u);
  EXPECT_TRUE(holds(error_of([&] { graph.walk({place("N3"), place("W3")}, "map"); }), "map: no way from N3"));

  const auto dataset = make_dataset("streetlearn", folder, {{"size", 84}});
  const Traversal route = dataset->load("route-1");  // the farthest of the arms' ends: at 60 m
  EXPECT_EQ(route.frames, 7);
  EXPECT_NEAR(route.positions[6], 60, 0.1);
  for (int frame = 0; frame < route.frames; ++frame) EXPECT_EQ(route.images->fault(frame), "");
  EXPECT_EQ(bytes_of(folder), before);
}

TEST(StreetGraph, HumansWalkTheLinksOfManhattan) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "manhattan-graph");
  if (folder.empty()) GTEST_SKIP() << "the graph of Manhattan is not there";
  const auto began = std::chrono::steady_clock::now();
  const StreetGraph graph = StreetGraph::from_files(folder + "/nodes.txt", folder + "/links.txt");
  RecordProperty("milliseconds",
                 std::to_string((std::chrono::steady_clock::now() - began) / std::chrono::milliseconds(1)));
  ASSERT_EQ(graph.places().size(), 29'641u);
  std::size_t links = 0;
  for (const StreetPlace& place : graph.places()) links += place.links.size();
  EXPECT_EQ(links, 61'319u);
  const TextTable routes(folder + "/human-routes.csv", {',', false});
  ASSERT_EQ(routes.rows(), 100);
  for (int row = 0; row < routes.rows(); ++row)
    for (int column = 1, from = -1; column < routes.columns(row); ++column) {
      const int to = graph.find(std::string(routes.text(row, column)));
      ASSERT_GE(to, 0) << row;
      const auto leads = [&](const StreetLink& link) { return link.to == to; };
      if (from >= 0) {
        const auto& out = graph.places()[static_cast<std::size_t>(from)].links;
        EXPECT_TRUE(std::any_of(out.begin(), out.end(), leads)) << row << ", " << column;
      }
      from = to;
    }
}

TEST(Geometry, HeadingsBetweenPlaces) {
  EXPECT_NEAR(heading_between(0, 0, 1, 0), 0, 1e-9);
  EXPECT_NEAR(heading_between(0, 0, 0, 1), 90, 1e-9);
  EXPECT_NEAR(heading_between(0, 179.9999, 0, -179.9999), 90, 1e-9);  // over the date line
  EXPECT_NEAR(std::abs(heading_between(1, 5, 0, 5)), 180, 1e-9);
  EXPECT_NEAR(heading_between(60, 0, 60.00001, 0.00002), 45, 1e-3);  // a degree east is half as long there
  EXPECT_NEAR(heading_between(0, 0, 0, -1e-9), -90, 1e-6);           // a tenth of a millimetre
}

}  // namespace
}  // namespace citylearn::testing
