// SPDX-License-Identifier: Apache-2.0
// Streets of OpenStreetMap: reading extracts, and recordings as views of them.
#include <set>

#include "core/files/files.h"
#include "env_service/dataset_io/folder_dataset.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/streets/street_graph.h"
#include "tests/paths.h"
#include "tests/support/data/layouts.h"
#include "tests/support/data/real_data.h"
#include "tests/support/log.h"

namespace citylearn::testing {
namespace {

/// Metres east and north of 0, 0 as degrees.
std::string degrees(double metres) { return fmt::format("{:.9f}", metres / kDegree); }

/// An extract in XML. Ways that share nodes are streets that meet there.
class OsmText {
 public:
  OsmText& node(long id, double east, double north) {
    text_ += fmt::format("<node id='{}' version='1' lat='{}' lon='{}'/>\n", id, degrees(north), degrees(east));
    return *this;
  }
  OsmText& way(const std::vector<long>& nodes, const std::string& tags) {
    text_ += fmt::format("<way id='{}' version='1'>", ++ways_);
    for (const long id : nodes) text_ += fmt::format("<nd ref='{}'/>", id);
    std::istringstream pairs(tags);
    for (std::string pair; pairs >> pair;)
      text_ += fmt::format("<tag k='{}' v='{}'/>", pair.substr(0, pair.find('=')), pair.substr(pair.find('=') + 1));
    text_ += "</way>\n";
    return *this;
  }
  OsmText& add(const std::string& text) {
    text_ += text + "\n";
    return *this;
  }
  std::string text() const { return "<?xml version='1.0'?>\n<osm version='0.6'>\n" + text_ + "</osm>\n"; }

 private:
  std::string text_;
  int ways_ = 0;
};

/// Returns the links between nodes, "n1>n2". The places between those are called n1-n2.1 and so on.
std::set<std::string> streets_of(const StreetGraph& graph) {
  std::set<std::string> found;
  for (const StreetPlace& place : graph.places())
    for (const StreetLink& link : place.links) {
      std::string to = graph.places()[static_cast<std::size_t>(link.to)].id;
      if (const std::size_t dash = to.find('-'), dot = to.find('.'); dot != to.npos)
        to = to.substr(0, dash) == place.id ? to.substr(dash + 1, dot - dash - 1) : to.substr(0, dash);
      if (place.id.find('.') == place.id.npos) found.insert(place.id + ">" + to);
    }
  return found;
}

class Osm : public ::testing::Test {
 protected:
  StreetGraph read(const OsmText& osm) const {
    make_file(folder_ / "town.osm", osm.text());
    return StreetGraph::from_osm(folder_ / "town.osm");
  }
  Traversal load(const std::string& name, std::optional<StateRule> rule = StateRule::kStreet) const {
    const auto dataset = make_dataset("plain", folder_.path());
    dataset->walk_by(rule);
    return select(*dataset, name, {});
  }
  Folder folder_;
};

/// A square of 100 m, 1 to 4 counterclockwise from the south-west, each street a way of its own.
OsmText square(const std::string& west = "highway=residential") {
  return OsmText()
      .node(1, 0, 0)
      .node(2, 100, 0)
      .node(3, 100, 100)
      .node(4, 0, 100)
      .way({1, 2}, "highway=residential")
      .way({2, 3}, "highway=primary_link")
      .way({3, 4}, "highway=unclassified")
      .way({4, 1}, west);
}

TEST_F(Osm, StreetsHaveAPlaceEveryTenMetres) {
  const StreetGraph graph = read(square());
  EXPECT_EQ(graph.places().size(), 40u);
  EXPECT_EQ(graph.links(), 80u);
  std::vector<std::uint32_t> rows;
  const StreetMap map = graph.map(rows);
  const int corner = graph.find("n1"), third = graph.find("n1-n2.3");
  ASSERT_GE(third, 0);
  EXPECT_NEAR(map.east[static_cast<std::size_t>(third)] - map.east[static_cast<std::size_t>(corner)], 30, 0.01);
  for (const StreetLink& link : graph.places()[static_cast<std::size_t>(third)].links)
    EXPECT_NEAR(link.heading, link.to == graph.find("n1-n2.4") ? 90 : 270, 0.01);
  EXPECT_EQ(graph.description()[0], "streets of town.osm: ways for cars 4, nodes 4");
  EXPECT_EQ(graph.description()[1], "streets: places 40, links 80, junctions 0, dead ends 0, one-way links 0");
}

TEST_F(Osm, DirectionsAreThoseOfCars) {
  // Closed by both ways along three sides, so that the west side may be one-way: drawn from 4 to 1.
  const auto west = [&](const std::string& tags) {
    const std::set<std::string> found = streets_of(read(square(tags)));
    return std::pair(found.contains("n4>n1"), found.contains("n1>n4"));
  };
  const std::pair along(true, false), back(false, true), both(true, true), none(false, false);
  for (const char* tags :
       {"highway=residential oneway=yes", "highway=road oneway=1", "highway=road oneway=true", "highway=motorway",
        "highway=tertiary junction=roundabout", "highway=tertiary junction=circular", "highway=motorway oneway=yes"})
    EXPECT_EQ(west(tags), along) << tags;
  for (const char* tags :
       {"highway=residential oneway=-1", "highway=residential oneway=reverse", "highway=motorway oneway=-1"})
    EXPECT_EQ(west(tags), back) << tags;
  for (const char* tags :
       {"highway=residential oneway=no", "highway=motorway oneway=no", "highway=motorway_link",
        "highway=residential access=private motor_vehicle=yes", "highway=residential access=destination"})
    EXPECT_EQ(west(tags), both) << tags;
  for (const char* tags : {"highway=footway", "highway=service", "highway=residential area=yes",
                           "highway=residential access=no", "highway=residential motorcar=private", "railway=tram"})
    EXPECT_EQ(west(tags), none) << tags;
}

TEST_F(Osm, WaysMeetAtSharedNodesAlone) {
  // A way from 5 crosses the square's east side at 6, at whose spot that has a node of its own, 7: a bridge. Through 8
  // it meets the north side, in which it lies between 3 and 4.
  OsmText osm = OsmText().node(1, 0, 0).node(2, 100, 0).node(3, 100, 100).node(4, 0, 100);
  osm.node(5, 0, 50).node(6, 100, 50).node(7, 100, 50).node(8, 50, 100).node(9, 150, 50);
  osm.way({1, 2, 7, 3, 8, 4, 1}, "highway=residential").way({5, 6, 9, 8}, "highway=residential");
  const StreetGraph graph = read(osm);
  EXPECT_EQ(streets_of(graph),
            (std::set<std::string>{"n1>n2", "n2>n1", "n2>n7", "n7>n2", "n7>n3", "n3>n7", "n3>n8", "n8>n3", "n8>n4",
                                   "n4>n8", "n4>n1", "n1>n4", "n5>n6", "n6>n5", "n6>n9", "n9>n6", "n9>n8", "n8>n9"}));
  EXPECT_EQ(graph.places()[static_cast<std::size_t>(graph.find("n8"))].links.size(), 3u);
}

TEST_F(Osm, CurvesKeepTheirBends) {
  // Nodes 2 m apart along a quarter of a circle of 20 m: places are 5 m apart or a little more.
  OsmText osm;
  std::vector<long> ids;
  for (int k = 0; k <= 15; ++k) {
    osm.node(k + 1, 20 * std::sin(k * 0.1), 20 * std::cos(k * 0.1));
    ids.push_back(k + 1);
  }
  const StreetGraph graph = read(osm.way(ids, "highway=residential"));
  EXPECT_EQ(graph.places().size(), 6u) << "every third node";
  for (const StreetPlace& place : graph.places())
    EXPECT_NEAR(std::hypot(place.latitude, place.longitude) * kDegree, 20, 0.05) << "it is on the circle";
}

TEST_F(Osm, WaysEndWhereNodesAreMissing) {
  OsmText osm = square();
  osm.node(5, 300, 0).node(6, 400, 0).way({2, 90, 5, 6}, "highway=residential").way({6, 91}, "highway=residential");
  osm.way({1, 3}, "highway=residential access=private").way({2, 4}, "highway=steps");
  osm.add("<relation id='1' version='1'><tag k='type' v='restriction'/></relation>");
  const StreetGraph graph = read(osm);
  EXPECT_EQ(graph.places().size(), 40u) << "5 to 6 is apart";
  EXPECT_EQ(graph.description()[0],
            "streets of town.osm: ways for cars 6, nodes 6, nodes that are not in the file 2 (ways end before them), "
            "private ways left out 1, footways and others left out 1, turn restrictions 1 (not followed), places left "
            "out without a way there and back 11");
}

TEST_F(Osm, WrongExtractsEndInOneLine) {
  const std::string whole = square().text();
  const auto told = [&](const std::string& name, const std::string& text) {
    make_file(folder_ / name, text);
    const std::string line = error_of([&] { StreetGraph::from_osm(folder_ / name); });
    EXPECT_TRUE(line.starts_with(folder_ / name)) << line;
    EXPECT_EQ(line.find('\n'), line.npos);
    return line;
  };
  const std::string damaged = "is not an extract of OpenStreetMap, or a damaged one";
  EXPECT_TRUE(holds(told("a.osm", whole.substr(0, whole.size() - 40)), damaged));
  for (const char* name : {"a.osm", "a.osm.pbf", "a.osm.gz", "a.osm.bz2"})
    for (const std::string& text : {std::string(), std::string("<html>404 Not Found</html>"), std::string(100, '\0')})
      EXPECT_TRUE(holds(told(name, text), name)) << text.size();
  EXPECT_TRUE(
      holds(told("a.osm", OsmText().way({1, 2}, "highway=residential").text()),
            "has no streets on which cars can go there and back (streets of a.osm: ways for cars 1, nodes that are "
            "not in the file 2"));
  EXPECT_TRUE(holds(told("a.osm", "<osmChange version='0.6'></osmChange>"), "holds changes of a map, not a map"));
  OsmText large;
  large.node(1, 0, 0).node(2, 8e6, 0).way({1, 2}, "highway=residential");
  EXPECT_TRUE(
      holds(told("a.osm", large.text()), "has streets with more than 1048576 links (cut a part out: osmium extract"));
  EXPECT_TRUE(
      holds(error_of([&] { StreetGraph::find_osm_in(folder_.path()); }), "two extracts of a map, a.osm and a.osm.bz2"));
}

/// Frames each metre along stops (metres), of two features: east and north.
void write_drive(const Folder& folder, const std::string& name, const std::vector<std::pair<double, double>>& stops) {
  std::string features, poses = "lat,lon\n";
  for (std::size_t leg = 0; leg + 1 < stops.size(); ++leg) {
    const auto [east, north] = stops[leg];
    const double x = stops[leg + 1].first - east, y = stops[leg + 1].second - north, metres = std::hypot(x, y);
    for (double at = 0; at < metres; ++at) {
      features += fmt::format("{},{}\n", east + x * at / metres, north + y * at / metres);
      poses += degrees(north + y * at / metres) + "," + degrees(east + x * at / metres) + "\n";
    }
  }
  make_file(folder / (name + ".csv"), features);
  make_file(folder / (name + ".poses.csv"), poses);
}

/// Two recordings of three frames, there and back along a street of 10 m.
class Counted : public FolderDataset {
 public:
  explicit Counted(const std::string& folder) : FolderDataset("plain", folder, "recordings") {}
  std::vector<std::string> names() override { return {"day", "night"}; }
  int reads = 0;

 private:
  Traversal read(const std::string& name) override {
    ++reads;
    Traversal traversal = unfilled(name, 3, folder_);
    locate(traversal, {0, 0, 0}, {0, 0.00009, 0});
    traversal.dimension = 1;
    traversal.features = {1, 2, 3};
    return traversal;
  }
};

TEST_F(Osm, RecordingsAreReadOnceToFindWhatTheyShow) {
  OsmText street;
  street.node(1, 0, 0).node(2, 10, 0).way({1, 2}, "highway=residential");
  make_file(folder_ / "town.osm", street.text());
  Counted checked(folder_.path()), hosted(folder_.path());
  ASSERT_NE(checked.streets(), nullptr);
  for (const std::string& name : checked.names()) checked.load(name);
  EXPECT_EQ(checked.describe_streets().back(),
            "streets: 2 links, shown by day 2, night 2, all 2, of these there and back 2");
  EXPECT_EQ(checked.reads, 2);
  hosted.walk_by(StateRule::kStreet);
  EXPECT_EQ(hosted.load("day").frames, 2);
  EXPECT_EQ(hosted.reads, 2);
}

TEST_F(Osm, LinksShowWhatWasRecordedThere) {
  make_file(folder_ / "town.osm", square().text());
  // Both drive 3 m to the right of the middle: by day around the square and back, at night around it alone.
  write_drive(folder_, "day",
              {{0, -3}, {103, -3}, {103, 103}, {-3, 103}, {-3, -3}, {3, -3}, {3, 97}, {97, 97}, {97, 3}, {0, 3}});
  write_drive(folder_, "night", {{0, -3}, {103, -3}, {103, 103}, {-3, 103}, {-3, -3}, {50, -3}});
  make_file(folder_ / "other.csv", "1,2\n3,4\n");
  const Log log;
  const Traversal day = load("day"), night = load("night");
  EXPECT_TRUE(log.has(
      "streets: 80 links, shown by day 80, night 40, all 40, of these there and back 40; without positions: other"))
      << log.text();
  ASSERT_EQ(day.frames, 40);
  EXPECT_EQ(day.streets->hash(), night.streets->hash());
  EXPECT_EQ(day.rule, StateRule::kStreet);
  for (int link = 0; link < 40; ++link) {
    const auto i = static_cast<std::size_t>(link);
    const float east = static_cast<float>(day.longitude[i] * kDegree),
                north = static_cast<float>(day.latitude[i] * kDegree);
    for (const Traversal* one : {&day, &night}) {
      EXPECT_LE(std::hypot(one->feature(link)[0] - east, one->feature(link)[1] - north), 4.5f) << one->name << link;
      if (north == 0 && east > 5 && east < 95) {
        EXPECT_EQ(one->feature(link)[1], -3) << "seen on the way east";
      }
    }
  }
  EXPECT_EQ(load("day", {}).streets, nullptr) << "without --rule it is a line";
  EXPECT_TRUE(holds(error_of([&] { load("other"); }), "traversal 'other' has no latitude and longitude"));
  EXPECT_TRUE(
      holds(error_of([&] { load("day", StateRule::kStreetLearn); }), "--rule: a map of OpenStreetMap is walked"));
  write_drive(folder_, "away", {{5000, 0}, {5100, 0}});
  EXPECT_TRUE(
      holds(error_of([&] { load("day"); }), "no streets lead there and back of which all recordings have a view"));
}

TEST(OsmOfPyosmium, HasTheStreetsOfItsTruth) {
  const std::string folder = real_data(CITYLEARN_SOURCE_DIR, "formats/drives-2026/osm");
  if (folder.empty()) GTEST_SKIP() << "skipped: no extracts; CITYLEARN_DATA names their folder";
  const StreetGraph grid = StreetGraph::from_osm(folder + "/grid.osm.pbf");
  std::set<std::string> nodes;
  const std::set<std::string> streets = streets_of(grid);
  for (const std::string& street : streets) nodes.insert(street.substr(0, street.find('>')));
  EXPECT_EQ(nodes.size(), 45u);
  EXPECT_EQ(streets.size(), 94u) << "98 pieces, of which 4 lead to the ends of columns 2 and 3 or from there";
  EXPECT_TRUE(holds(grid.description()[0], "ways for cars 17, nodes 49, nodes that are not in the file 1 ("));
  EXPECT_TRUE(
      holds(grid.description()[0], "private ways left out 1, footways and others left out 1, turn restrictions 1"));
  for (const char* street : {"n1010>n1011", "n1025>n1024", "n1012>n1022", "n1033>n1023", "n2010>n2017", "n1041>n1051",
                             "n2003>n1034", "n1014>n2003", "n2021>n2020"})
    EXPECT_TRUE(streets.contains(street)) << street;
  for (const char* street : {"n1011>n1010", "n1024>n1025", "n1022>n1012", "n1023>n1033", "n2017>n2010", "n1040>n1041",
                             "n2003>n1024", "n1023>n2003"})
    EXPECT_FALSE(streets.contains(street)) << street;
  const StreetGraph on_ways = StreetGraph::from_osm(folder + "/grid-locations-on-ways.osm.pbf"),
                    whole = StreetGraph::from_osm(folder + "/grid-complete.osm");
  EXPECT_EQ(streets_of(on_ways), streets_of(whole));
  EXPECT_EQ(on_ways.links(), whole.links());
  EXPECT_TRUE(streets_of(whole).contains("n1005>n2099"));
  EXPECT_EQ(streets_of(whole).size(), streets.size() + 2);
  EXPECT_TRUE(holds(StreetGraph::from_osm(folder + "/corner-simple.osm.pbf").description()[0],
                    "ways for cars 7, nodes 14, nodes that are not in the file 16 "));
  const Folder copy;
  const std::string pbf = read_file(folder + "/grid.osm.pbf", 1 << 20);
  for (const std::string& damaged : {pbf + std::string(100, '\0'), pbf.substr(0, pbf.size() - 5), pbf + "x"}) {
    make_file(copy / "a.osm.pbf", damaged);
    EXPECT_TRUE(holds(error_of([&] { StreetGraph::from_osm(copy / "a.osm.pbf"); }), "damaged")) << damaged.size();
  }
}

}  // namespace
}  // namespace citylearn::testing
