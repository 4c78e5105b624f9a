// SPDX-License-Identifier: Apache-2.0
#include "env_service/traversal/places.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "env_service/dataset_io/folder_dataset.h"
#include "tests/support/data/layouts.h"
#include "tests/support/log.h"

namespace citylearn::testing {
namespace {

constexpr int kFrames = 40;
constexpr double kStep = 5;  // metres

/// A dataset of a plug-in: 40 frames, 5 m apart along a meridian; what a case changes is wrong.
class Meridian : public FolderDataset {
 public:
  explicit Meridian(std::map<int, std::pair<double, double>> changes)
      : FolderDataset("meridian", "/drives", "nothing"), changes_(std::move(changes)) {}
  std::vector<std::string> names() override { return {"summer"}; }

 private:
  Traversal read(const std::string& name) override {
    Traversal traversal = unfilled(name, kFrames, folder_);
    std::vector<double> north, east;
    for (int frame = 0; frame < kFrames; ++frame) {
      const auto change = changes_.find(frame);
      north.push_back(change == changes_.end() ? 50 + kStep * frame / kDegree : change->second.first);
      east.push_back(change == changes_.end() ? 8 : change->second.second);
    }
    locate(traversal, north, east);
    return traversal;
  }

  std::map<int, std::pair<double, double>> changes_;
};

double length(const Traversal& traversal, int first, int last) {
  return traversal.positions[static_cast<std::size_t>(last)] - traversal.positions[static_cast<std::size_t>(first)];
}

TEST(ImpossiblePlaces, AreForgottenInOneLine) {
  const std::pair<double, double> none{0, 0}, near{50.01, 8}, far{20, 8}, equator{0, 8};
  struct Case {
    const char* what;
    std::map<int, std::pair<double, double>> changes;
    const char* told;
  };
  for (const Case& one :
       {Case{"no fix", {{7, none}, {8, none}, {20, none}}, "3 of 40 places are ignored, the first frame 7: 0, 0 is"},
        Case{"no fix at first",
             {{0, none}, {1, none}, {2, none}},
             "3 of 40 places are ignored, the first frame 0: 0, 0"},
        Case{"one wrong fix",
             {{9, near}},
             "1 of 40 places are ignored, the first frame 9: 1.072 km lie between frame 8"},
        Case{"two fixes", {{9, far}, {10, far}}, "2 of 40 places are ignored, the first frame 9: 33"},
        Case{"many of them", {{5, far}, {12, near}, {13, far}, {20, near}, {30, far}}, "5 of 40 places are ignored"},
        Case{"50 m aside", {{9, {50 + kStep * 9 / kDegree, 8.0007}}}, "1 of 40 places are ignored, the first frame 9"},
        Case{"an empty field read as 0", {{9, equator}}, "1 of 40 places are ignored, the first frame 9: 55"},
        Case{"wrong first", {{0, near}}, "1 of 40 places are ignored, the first frame 0: 1.107 km lie between frame 0"},
        Case{"two wrong first", {{0, far}, {1, far}}, "2 of 40 places are ignored, the first frame 0: 33"},
        Case{"wrong last", {{38, far}, {39, far}}, "2 of 40 places are ignored, the first frame 38"}}) {
    SCOPED_TRACE(one.what);
    const Log log;
    const Traversal traversal = Meridian(one.changes).load("summer");
    EXPECT_EQ(log.lines(), 1);
    EXPECT_TRUE(log.has(std::string("/drives: traversal 'summer': ") + one.told)) << log.text();
    // Wrong ones in the middle are between those around; at the ends they are unknown.
    int first = 0, last = kFrames - 1;
    while (one.changes.contains(first)) ++first;
    while (one.changes.contains(last)) --last;
    for (int frame = 0; frame < kFrames; ++frame) {
      const auto at = static_cast<std::size_t>(frame);
      const bool known = frame >= first && frame <= last;
      EXPECT_EQ(std::isfinite(traversal.latitude[at]) && std::isfinite(traversal.longitude[at]), known) << frame;
      EXPECT_EQ(std::isfinite(traversal.positions[at]), known) << frame;
      if (!known) continue;
      EXPECT_NEAR(traversal.positions[at], kStep * (frame - first), 0.01) << frame;
      EXPECT_NEAR((traversal.latitude[at] - 50) * kDegree, kStep * frame, 0.01) << frame;
    }
  }
}

TEST(ImpossiblePlaces, ADriveThatCanBeStaysAsItIs) {
  const Log log;
  const Traversal whole = Meridian({}).load("summer");
  EXPECT_NEAR(length(whole, 0, kFrames - 1), 195, 0.01);
  std::map<int, std::pair<double, double>> simulated, detour;
  for (int frame = 0; frame < kFrames; ++frame) simulated[frame] = {kStep * frame / kDegree, 0};
  EXPECT_NEAR(length(Meridian(simulated).load("summer"), 0, kFrames - 1), 195, 0.01) << "a simulator begins at 0, 0";
  for (int frame = 10; frame < kFrames; ++frame) detour[frame] = {50 + (kStep * frame + 80) / kDegree, 8};
  EXPECT_NEAR(length(Meridian(detour).load("summer"), 0, kFrames - 1), 275, 0.01) << "80 m without a frame";
  EXPECT_EQ(log.text(), "");
}

TEST(ImpossiblePlaces, AJumpIsTold) {
  std::map<int, std::pair<double, double>> away, exchanged, west, radians, beyond, many;
  for (int frame = 0; frame < kFrames; ++frame) {
    const double north = 50 + kStep * frame / kDegree;
    if (frame >= 20) {
      away[frame] = {north + 0.2, 8};
      exchanged[frame] = {8, north};
      west[frame] = {north, -8};
    }
    if (frame % 2) many[frame] = {north + frame % 7, 8};
    radians[frame] = {north * M_PI / 180, 8 * M_PI / 180};
    beyond[frame] = {north * 1e7, 8e7};
  }
  const auto told = [](const auto& changes) { return error_of([&] { Meridian(changes).load("summer"); }); };
  EXPECT_TRUE(holds(told(exchanged), "traversal 'summer': 6")) << told(exchanged);
  EXPECT_TRUE(holds(told(exchanged), "km lie between frame 19 and frame 20")) << told(exchanged);
  EXPECT_TRUE(holds(told(west), "km lie between frame 19 and frame 20")) << told(west);
  EXPECT_TRUE(holds(told(radians), "give degrees, not radians")) << told(radians);
  EXPECT_TRUE(holds(told(beyond), "frame 0 is at 500000000, 80000000: not a latitude")) << told(beyond);
  EXPECT_TRUE(holds(told(many), "too many")) << told(many);
  const Log log;
  const Traversal traversal = Meridian(away).load("summer");
  EXPECT_EQ(log.lines(), 1);
  EXPECT_TRUE(log.has("22.244 km lie between frame 19 and frame 20")) << log.text();
  EXPECT_FALSE(std::isnan(traversal.positions[30]));
}

TEST(ImpossiblePlaces, ZonesOfAPlane) {
  std::vector<double> x, y(kFrames), metres(kFrames);
  for (int frame = 0; frame < kFrames; ++frame) x.push_back((frame < 20 ? 833'000 : 167'000) + kStep * frame);
  const auto name = [](std::size_t row) { return "row " + std::to_string(row); };
  EXPECT_EQ(error_of([&] {
              forget_impossible({x, y, {}, false, "poses.csv", "places", name});
            }),
            "poses.csv: 665.995 km lie between row 19 and row 20 (mend the places; do units, signs or zones of UTM "
            "change?)");
  for (int frame = 20; frame < kFrames; ++frame) x[static_cast<std::size_t>(frame)] += 666'000;
  x[5] = 0;
  const Log log;
  EXPECT_TRUE(forget_impossible({x, y, {}, false, "poses.csv", "places", name}).empty());
  EXPECT_NEAR(x[5], 833'025, 1e-6);
  EXPECT_TRUE(
      log.has("poses.csv: 1 of 40 places are ignored, the first row 5: 833.020 km lie between row 4 and row 5"));
}

TEST(ImpossiblePlaces, CopiesOfAFrozenReceiver) {
  std::map<int, std::pair<double, double>> frozen, standing;
  for (int frame = 0; frame < kFrames; ++frame) {
    if (frame > 10 && frame < 20) frozen[frame] = {50 + kStep * 10 / kDegree, 8};
    standing[frame] = {50 + kStep * (frame <= 10 ? frame : frame < 20 ? 10 : frame - 9) / kDegree, 8};
  }
  const Log log;
  EXPECT_NEAR(length(Meridian(standing).load("summer"), 0, kFrames - 1), 150, 0.01);
  EXPECT_EQ(log.text(), "") << "a vehicle that stands goes on as fast as before";
  const Traversal traversal = Meridian(frozen).load("summer");
  EXPECT_NEAR(length(traversal, 0, kFrames - 1), 195, 0.01);
  EXPECT_TRUE(log.has("9 of 40 places are ignored, the first frame 11")) << log.text();
  EXPECT_NEAR(length(traversal, 0, 15), 75, 0.01) << "between the places around";
  std::map<int, std::pair<double, double>> tunnel;  // 130 m without a fix
  for (int frame = 7; frame < 33; ++frame) tunnel[frame] = {0, 0};
  const Traversal unknown = Meridian(tunnel).load("summer");
  EXPECT_NEAR(length(unknown, 0, kFrames - 1), 195, 0.01);
  EXPECT_TRUE(std::isnan(unknown.positions[7]) && std::isnan(unknown.positions[32]));
}

// A second of a log, a frame half a second. The longitude goes on from 179.999 to -179.999.
TEST(ImpossiblePlaces, ALogIsCleanedBeforeFramesAreBetweenItsRows) {
  GpsRows rows;
  rows.log = "gps.log";
  for (int second = 0; second < 20; ++second) {
    const double east = 180 + (second - 9.5) * 1e-4;
    rows.add(second, second == 5 ? -17.01 : -17, east > 180 ? east - 360 : east);
  }
  Traversal traversal;
  for (int frame = 0; frame < 39; ++frame) traversal.times.push_back(0.5 * frame);
  const Log log;
  locate(traversal, rows, 0);
  EXPECT_TRUE(log.has("gps.log: 1 of 20 GPS fixes are ignored, the first 5 s into the log")) << log.text();
  const double step = 0.5e-4 * kDegree * std::cos(17 * M_PI / 180);
  for (int frame = 0; frame < 39; ++frame)
    EXPECT_NEAR(traversal.positions[static_cast<std::size_t>(frame)], step * frame, 0.01) << frame;
}

TEST(Heights, UnknownOnesAreBetweenThoseAround) {
  const double unknown = std::nan("");
  std::vector<double> heights{unknown, 100, -9999, unknown, 130, 1e30};
  fill_heights(heights);
  EXPECT_EQ(heights, (std::vector<double>{100, 100, 110, 120, 130, 130}));
  heights = {unknown, -9999};
  fill_heights(heights);
  EXPECT_TRUE(heights.empty());
}

TEST(Heights, OfATableMayBeEmptyButNotNonsense) {
  Folder folder;
  make_file(folder / "day.csv", "1\n2\n3\n");
  const auto load = [&](const std::string& poses) {
    make_file(folder / "day.poses.csv", poses);
    return make_dataset("plain", folder.path())->load("day");
  };
  EXPECT_EQ(load("x,y,z\n0,0,\n3,0,\n6,0,\n").positions, (std::vector<float>{0, 3, 6}));
  EXPECT_EQ(load("x,y,z\n0,0,1\n3,0,\n6,0,9\n").positions, (std::vector<float>{0, 5, 10}));  // 3 on and 4 up
  EXPECT_EQ(load("x,y,altitude\n0,0,1\n3,0,\n6,0,9\n").positions, (std::vector<float>{0, 5, 10}));
  const Log log;
  load("x,y,up,z,yaw,\n0,0,1,1,0,\n3,0,1,1,0\n6,0,1,1,0\n");
  EXPECT_TRUE(log.has("day.poses.csv: columns that are not read: up, yaw")) << log.text();
  load("frame,file,x,y,z,height\n0,a,0,0,1,9\n");
  EXPECT_TRUE(log.has("day.poses.csv: columns that are not read: file, height")) << log.text();
  EXPECT_EQ(error_of([&] { load("x,y,z\n0,0,1\n3,0,-9999\n6,0,9\n"); }),
            (folder / "day.poses.csv") + ":3: not a height in metres (leave z empty where it is unknown)");
}

}  // namespace
}  // namespace citylearn::testing
