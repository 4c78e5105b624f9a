// SPDX-License-Identifier: Apache-2.0
// Streets that recordings have run through.
#include "env_service/streets/drive_streets.h"

#include "env_service/dataset_io/selection.h"
#include "env_service/geometry/geometry.h"
#include "tests/support/data/layouts.h"

namespace citylearn::testing {
namespace {

using Corners = std::vector<std::pair<double, double>>;

Drive drive_at(std::vector<double> east, std::vector<double> north) {
  Drive drive{std::move(east), std::move(north)};
  drive.along = metres_along_plane(drive.east, drive.north);
  return drive;
}

/// A drive along straight lines from corner to corner, with a frame every 10 m.
Drive drive_by(const Corners& corners) {
  std::vector<double> east, north;
  double next = 0;  // metres to the next frame
  for (std::size_t i = 0; i + 1 < corners.size(); ++i) {
    const auto [x, y] = corners[i];
    const double way_x = corners[i + 1].first - x, way_y = corners[i + 1].second - y, length = std::hypot(way_x, way_y);
    for (; next <= length; next += 10) {
      east.push_back(x + way_x * next / length);
      north.push_back(y + way_y * next / length);
    }
    next -= length;
  }
  return drive_at(east, north);
}

/// Frames 0 to 9 go east to (47, 0), 19 to 28 south from (0, 47), and cross the way east at (0, 0) between frames 4 and
/// 5, and 23 and 24: nearest are 4, (-3, 0), and 24, (0, -3). From frame 39 on, (-39, 0), they go east again.
const Corners kEight{{-43, 0}, {47, 0}, {47, 50}, {0, 50}, {0, -50}, {-46, -50}, {-46, 0}, {-13, 0}};

/// Frames 0 to 10 go east to (47, 0), 11 to 20 back 4 m beside: nearest to (-49, 4) is (-53, 0).
const Corners kEastAndBack{{-53, 0}, {47, 0}, {47, 4}, {-53, 4}}, kNorthAndBack{{0, -53}, {0, 47}, {4, 47}, {4, -53}};

/// One drive after the other.
Drive drives_by(const std::vector<Corners>& ways) {
  Drive all;
  for (const Corners& way : ways) {
    const Drive one = drive_by(way);
    all.begins.push_back(static_cast<int>(all.east.size()));
    all.east.insert(all.east.end(), one.east.begin(), one.east.end());
    all.north.insert(all.north.end(), one.north.begin(), one.north.end());
    all.along.insert(all.along.end(), one.along.begin(), one.along.end());
  }
  return all;
}

std::vector<std::string> meetings_of(const DriveStreets& streets) {
  std::vector<std::string> lines = streets.description();
  lines.erase(lines.begin());
  return lines;
}

/// Returns the frame that is shown where one faces from the place of one frame to that of another; -1 where no link
/// leads there.
int shown(const DriveStreets& streets, std::size_t from, std::size_t to) {
  for (std::size_t link = 0; link < streets.map.links(); ++link)
    if (static_cast<int>(streets.map.from[link]) == streets.places.at(from) &&
        static_cast<int>(streets.map.to[link]) == streets.places.at(to))
      return streets.shown[link];
  return -1;
}

TEST(DriveStreets, AnEightIsCrossedAndClosed) {
  const DriveStreets streets = streets_of(drive_by(kEight), "drive");
  EXPECT_EQ(
      streets.description(),
      (std::vector<std::string>{
          "streets: places 38, links 39, junctions 1, dead ends 0, one-way links 39; frames left out: 3, of which "
          "0 are at places that cannot be reached from the others, or not left for them, and 0 at unknown places",
          "streets: frame 24 meets frame 4 (90 degrees)",
          "streets: frames 39 to 41 run along frames 0 to 2 (0 degrees)"}));
  EXPECT_EQ(streets.places[24], streets.places[4]);
  EXPECT_EQ(streets.places[41], streets.places[2]);
  EXPECT_EQ(shown(streets, 38, 0), 38);
  EXPECT_EQ(shown(streets, 0, 1), 0);  // not 39 or 40, which were there later
  // At the crossing one goes straight on, or turns right for the south.
  const StateMap states(streets.map, StateRule::kStreet, 100);
  const auto facing = [&](int frame) {
    return static_cast<int>(std::find(streets.shown.begin(), streets.shown.end(), frame) - streets.shown.begin());
  };
  EXPECT_EQ(states.next(facing(3), kForward), facing(4));
  EXPECT_EQ(states.next(facing(4), kRight), facing(24));
  EXPECT_EQ(states.next(facing(24), kForward), facing(25));
  EXPECT_EQ(states.allowed(facing(3)), 1 << kForward);
  EXPECT_NEAR(states.heading(facing(24)), 180, 1e-3);
  EXPECT_EQ(states.steps_to({streets.places[28]})[static_cast<std::size_t>(facing(0))], 4 + 1 + 4);
}

TEST(DriveStreets, ABridgeDoesNotMeetWhatIsBelow) {
  Drive drive = drive_by(kEight);
  drive.height.assign(drive.east.size(), 0);
  for (std::size_t frame = 20; frame < 28; ++frame) drive.height[frame] = 5;
  EXPECT_EQ(meetings_of(streets_of(drive, "drive")),
            std::vector<std::string>{"streets: frames 39 to 41 run along frames 0 to 2 (0 degrees)"});
  for (double& height : drive.height) height *= 0.6;
  EXPECT_EQ(meetings_of(streets_of(drive, "drive")).size(), 2u);
  for (double& height : drive.height) height = std::nan("");
  EXPECT_EQ(meetings_of(streets_of(drive, "drive")).size(), 2u);
}

TEST(DriveStreets, HeightsOfAReceiverTellHighBridgesOfOneDriveAlone) {
  Drive drive = drive_by(kEight);
  drive.receiver = 5;
  drive.height.assign(drive.east.size(), 100);
  for (std::size_t frame = 20; frame < 28; ++frame) drive.height[frame] = 111;
  for (std::size_t frame = 39; frame < 42; ++frame) drive.height[frame] = 120;  // it drifts: the street is the same
  EXPECT_EQ(streets_of(drive, "drive").map.places(), 39u);  // no junction: the eight is a ring of 39 frames
  EXPECT_EQ(meetings_of(streets_of(drive, "drive")),
            std::vector<std::string>{"streets: frames 39 to 41 run along frames 0 to 2 (0 degrees)"});
  for (std::size_t frame = 20; frame < 28; ++frame) drive.height[frame] = 109;
  EXPECT_EQ(meetings_of(streets_of(drive, "drive")).size(), 2u);
  Drive days = drives_by({kEastAndBack, kNorthAndBack});
  days.receiver = 5;
  days.height.assign(42, 100);
  std::fill_n(days.height.begin(), 21, 130);  // of another day
  EXPECT_EQ(streets_of(days, "drives").map.places(), 21u);
}

TEST(DriveStreets, AStreetThereAndBackIsSeenInBothDirections) {
  // Frame 10 turns at (97, 3); the way back is 4 m beside, frame 11 at (88, 4), nearest to 9, and 20 at (-2, 4) to 0.
  const DriveStreets streets = streets_of(drive_by({{0, 0}, {97, 0}, {97, 4}, {-2, 4}}), "drive");
  EXPECT_EQ(meetings_of(streets),
            std::vector<std::string>{"streets: frames 11 to 20 run along frames 9 to 0 (180 degrees)"});
  EXPECT_EQ(streets.map.places(), 11u);
  EXPECT_EQ(streets.map.links(), 20u);
  for (int place = 0; place < 10; ++place) {
    EXPECT_EQ(shown(streets, place, place + 1), place);
    EXPECT_EQ(shown(streets, place + 1, place), place == 9 ? 10 : 19 - place);
  }
  EXPECT_TRUE(streets.description()[0].starts_with(
      "streets: places 11, links 20, junctions 0, dead ends 2, one-way links 0; frames left out: 1,"));
}

TEST(DriveStreets, LongerStepsPassThePlacesBetween) {
  // There with a frame every 10 m to (100, 0), back with one every 25 m.
  std::vector<double> east, north;
  for (int i = 0; i <= 10; ++i) east.push_back(10 * i), north.push_back(0);
  for (int i = 0; i <= 4; ++i) east.push_back(88 - 25 * i), north.push_back(3);
  const DriveStreets streets = streets_of(drive_at(east, north), "drive");
  EXPECT_EQ(shown(streets, 9, 8), 11);  // at (88, 3), from where the next one is at (63, 3)
  EXPECT_EQ(shown(streets, 8, 7), 11);
  EXPECT_EQ(shown(streets, 6, 5), 12);
  EXPECT_EQ(shown(streets, 9, 6), -1);
}

TEST(DriveStreets, NoiseOfAVehicleThatStandsMakesNoPlaces) {
  const Drive moving = drive_by(kEight);
  Drive stood = moving;
  for (int i = 0; i < 60; ++i) {  // at frame 7, up to .6 m off
    stood.east.insert(stood.east.begin() + 8, moving.east[7] + 0.5 * std::cos(i * 2.4));
    stood.north.insert(stood.north.begin() + 8, moving.north[7] + 0.5 * std::sin(i * 1.7));
  }
  const DriveStreets streets = streets_of(drive_at(stood.east, stood.north), "drive");
  EXPECT_EQ(streets.map.hash(), streets_of(moving, "drive").map.hash());
  EXPECT_EQ(streets.frames, 102);
  EXPECT_EQ(meetings_of(streets)[0], "streets: frame 84 meets frame 4 (90 degrees)");
}

TEST(DriveStreets, WhatNoWayComesBackToIsLeftOut) {
  Corners corners = kEight;
  corners[0].first -= 300;        // 30 frames before the eight
  corners.push_back({-13, 205});  // and 21 behind it, from frame 72 at (-13, 4)
  Drive drive = drive_by(corners);
  drive.east[35] = drive.north[35] = std::nan("");  // (7, 0) of the way east, just behind the crossing
  const DriveStreets streets = streets_of(drive, "drive");
  EXPECT_EQ(
      streets.description(),
      (std::vector<std::string>{
          "streets: places 37, links 38, junctions 1, dead ends 0, one-way links 38; frames left out: 55, of which 51 "
          "are at places that cannot be reached from the others, or not left for them, and 1 at unknown places",
          "streets: frame 54 meets frame 34 (90 degrees)",
          "streets: frames 69 to 71 run along frames 30 to 32 (0 degrees)"}));
  EXPECT_EQ(streets.places[29], -1);
  EXPECT_EQ(streets.places[35], -1);
  EXPECT_EQ(streets.places[72], -1);
  EXPECT_EQ(shown(streets, 34, 36), 34);
}

TEST(DriveStreets, TwoDrivesThatCrossHaveOneJunctionWithFourArms) {
  // The way north crosses that east at (0, 0), nearest to its frame 5, which is 26, and to frame 5 of the way east.
  const DriveStreets streets = streets_of(drives_by({kEastAndBack, kNorthAndBack}), "drives");
  EXPECT_EQ(
      streets.description(),
      (std::vector<std::string>{
          "streets: places 21, links 40, junctions 1, dead ends 4, one-way links 0; frames left out: 2, of which 0 are "
          "at places that cannot be reached from the others, or not left for them, and 0 at unknown places",
          "streets: frames 11 to 20 run along frames 9 to 0 (180 degrees)",
          "streets: frame 26 meets frame 5 (90 degrees)",
          "streets: frames 32 to 41 run along frames 30 to 21 (180 degrees)"}));
  EXPECT_EQ(streets.places[26], streets.places[5]);
  for (const std::size_t arm : {4, 6, 25, 27}) {
    EXPECT_NE(shown(streets, 5, arm), -1) << arm;
    EXPECT_NE(shown(streets, arm, 5), -1) << arm;
  }
  EXPECT_EQ(shown(streets, 25, 5), 25);
  EXPECT_EQ(shown(streets, 5, 27), 26);  // as the drive north saw it, and not the one east
}

TEST(DriveStreets, TwoDrivesMayCloseARingThatNeitherDoes) {
  // The second one begins on the last 14 m of the first, and ends on its first 6 m: its frames 0, 1, 2, 21 and 22, at
  // (100, 14), (100, 4), (100, -6), (0, -4) and (0, 6), are on the first one's way.
  const Corners north{{0, 0}, {0, 100}, {100, 100}, {100, 0}}, south{{100, 14}, {100, -50}, {0, -50}, {0, 14}};
  EXPECT_NE(error_of([&] { streets_of(drive_by(north), "north"); }), "");
  EXPECT_NE(error_of([&] { streets_of(drive_by(south), "south"); }), "");
  const DriveStreets ring = streets_of(drives_by({north, south}), "ring");
  EXPECT_TRUE(
      ring.description()[0].starts_with("streets: places 49, links 49, junctions 0, dead ends 0, one-way links 49;"));
  EXPECT_EQ(ring.apart, 0);
}

TEST(DriveStreets, ADriveThatMeetsNoOtherIsLeftOut) {
  Corners far = kEastAndBack, once{{20, -203}, {20, 197}};
  for (auto& [east, north] : far) north += 1000;
  far[1].first = far[2].first = 27;  // shorter than the others
  const DriveStreets streets = streets_of(drives_by({far, kEastAndBack, kNorthAndBack, once}), "drives");
  EXPECT_EQ(streets.map.places(), 21u);
  EXPECT_EQ(streets.map.links(), 40u);
  for (std::size_t frame = 0; frame < 17; ++frame) EXPECT_EQ(streets.places[frame], -1) << frame;
  // Who turns into the way of the last one cannot come back: only its frame at the crossing is at a place.
  EXPECT_EQ(std::count(streets.places.begin() + 17 + 42, streets.places.end(), -1), 40);
  EXPECT_EQ(streets.apart, 17 + 40);
}

TEST(DriveStreets, ADriveThatNeverComesBackHasNone) {
  const auto told = [](const Drive& drive) { return error_of([&] { streets_of(drive, "day"); }); };
  EXPECT_EQ(told(drive_by({{0, 0}, {300, 0}, {300, 300}})),
            "day: never crosses its earlier way, nor runs along it within 8.0 m (it is a line: leave out --rule)");
  // Two carriageways, 20 m apart, are two streets.
  EXPECT_NE(told(drive_by({{0, 0}, {300, 0}, {300, 20}, {0, 20}})), "");
  EXPECT_EQ(told(drive_at({5, 5, 5}, {1, 1, 1})),
            "day: stands, or fewer than two of its frames have places (leave out --rule)");
}

/// A folder with the eight by day, and a night a little beside it. Row r of a table is r.5, 7.
class RecordedStreets : public ::testing::Test {
 protected:
  RecordedStreets() {
    const Drive drive = drive_by(kEight);
    for (const auto& [name, off] : {std::pair("day", 0.0), {"night", 1.25}}) {
      std::string rows, poses = "x,y,z\n";
      for (std::size_t i = 0; i < drive.east.size(); ++i) {
        rows += std::to_string(i) + ".5,7\n";
        poses +=
            std::to_string(drive.east[i] + (i % 2 ? off : 0)) + "," + std::to_string(drive.north[i] - off) + ",0\n";
      }
      make_file(folder_ / (std::string(name) + ".csv"), rows);
      make_file(folder_ / (std::string(name) + ".poses.csv"), poses);
    }
  }
  Traversal load(const std::string& name, std::optional<StateRule> rule, const Selection& selection = {}) const {
    const auto dataset = make_dataset("plain", folder_.path());
    dataset->walk_by(rule);
    return select(*dataset, name, selection);
  }
  std::string refusal(std::optional<StateRule> rule) const {
    return error_of([&] { load("day", rule); });
  }
  Folder folder_;
};

TEST_F(RecordedStreets, AreWalkedByTheRuleOfStreetsAlone) {
  EXPECT_EQ(load("day", {}).streets, nullptr);
  EXPECT_EQ(load("day", {}).frames, 42);
  const Traversal day = load("day", StateRule::kStreet);
  EXPECT_EQ(day.frames, 39);
  EXPECT_EQ(day.states()->places(), 38);
  const DriveStreets streets = streets_of(drive_by(kEight), "drive");
  for (int state = 0; state < day.frames; ++state)
    EXPECT_EQ(day.feature(state)[0], static_cast<float>(streets.shown[static_cast<std::size_t>(state)]) + 0.5f);
  EXPECT_EQ(
      refusal(StateRule::kStreetFixed),
      "--rule: traversal 'day' has no map of streets, and was seen in the direction of the drive alone (give --rule "
      "street, or leave it out)");
}

TEST_F(RecordedStreets, ASiblingWalksOnTheMapThatItIsAlignedTo) {
  Selection selection;
  selection.align = "day";
  selection.by = "index";
  const Traversal day = load("day", StateRule::kStreet), night = load("night", StateRule::kStreet, selection);
  EXPECT_EQ(night.streets->hash(), day.streets->hash());
  EXPECT_EQ(night.features, day.features);
  EXPECT_NE(load("night", StateRule::kStreet).streets->hash(), day.streets->hash());
}

/// Two drives that cross, by day and at night, when they were a little beside. Row r of the n-th table is n, r.
class JoinedStreets : public ::testing::Test {
 protected:
  JoinedStreets() {
    write("monday", 0, kEastAndBack, 0);
    write("tuesday", 1, kNorthAndBack, 0);
    write("monday-night", 2, kEastAndBack, 1.25);
    write("tuesday-night", 3, kNorthAndBack, 1.25);
  }
  void write(const std::string& name, int number, const Corners& corners, double off) const {
    const Drive drive = drive_by(corners);
    std::string rows, poses = "x,y\n";
    for (std::size_t i = 0; i < drive.east.size(); ++i) {
      rows += std::to_string(number) + "," + std::to_string(i) + "\n";
      poses += std::to_string(drive.east[i] + off) + "," + std::to_string(drive.north[i] - off) + "\n";
    }
    make_file(folder_ / (name + ".csv"), rows);
    make_file(folder_ / (name + ".poses.csv"), poses);
  }
  Traversal load(const std::string& name, const Selection& selection = {},
                 std::optional<StateRule> rule = StateRule::kStreet) const {
    const auto dataset = make_dataset("plain", folder_.path());
    dataset->walk_by(rule);
    return select(*dataset, name, selection);
  }
  std::string refusal(const std::string& name, const Selection& selection = {}) const {
    return error_of([&] { load(name, selection); });
  }
  Folder folder_;
};

TEST_F(JoinedStreets, ShowTheFramesOfAllRecordings) {
  const Traversal week = load("monday+tuesday");
  EXPECT_EQ(week.name, "monday+tuesday");
  EXPECT_EQ(week.states()->places(), 21);
  EXPECT_EQ(week.frames, 40);
  const DriveStreets streets = streets_of(drives_by({kEastAndBack, kNorthAndBack}), "drives");
  for (int state = 0; state < week.frames; ++state) {
    const int frame = streets.shown[static_cast<std::size_t>(state)];
    EXPECT_EQ(week.feature(state)[0], frame < 21 ? 0 : 1);
    EXPECT_EQ(week.feature(state)[1], static_cast<float>(frame < 21 ? frame : frame - 21));
  }
}

TEST_F(JoinedStreets, OfAnotherSeasonHaveTheSamePlaces) {
  const Traversal day = load("monday+tuesday");
  const Traversal night = load("monday-night+tuesday-night", {.align = "monday+tuesday", .by = "index"});
  EXPECT_EQ(night.streets->hash(), day.streets->hash());
  for (int state = 0; state < day.frames; ++state) {
    EXPECT_EQ(night.feature(state)[0], day.feature(state)[0] + 2);
    EXPECT_EQ(night.feature(state)[1], day.feature(state)[1]);
  }
  const Selection half{.align = "monday+tuesday", .by = "index"};  // tuesday's day is its own sibling
  EXPECT_EQ(load("monday-night+tuesday", half).streets->hash(), day.streets->hash());
}

TEST_F(JoinedStreets, SayWhyTheyCannotBeJoined) {
  EXPECT_EQ(error_of([&] { load("monday+tuesday", {}, {}); }),
            "--traversal monday+tuesday: joins recordings to streets (add --rule street, or name one of them)");
  EXPECT_EQ(refusal("monday+monday"), "--traversal monday+monday: names a recording twice (name each once)");
  EXPECT_EQ(refusal("monday+"), "--traversal monday+: names nothing beside a + (name a recording on both sides)");
  EXPECT_EQ(refusal("monday-night+tuesday-night", {.align = "+tuesday"}),
            "--align-to +tuesday: names nothing beside a + (name a recording on both sides)");
  EXPECT_EQ(refusal("monday-night+tuesday-night", {.align = "monday+monday"}),
            "--align-to monday+monday: names a recording twice (name each once)");
  EXPECT_TRUE(holds(refusal("monday+sunday"), "no traversal 'sunday' (there are: monday, monday-night, tuesday"));
  EXPECT_EQ(refusal("monday-night+tuesday-night", {.align = "monday"}),
            "--align-to: names 1 of 2 recordings (name one for each of --traversal, in the same order, with + between "
            "them)");
  EXPECT_EQ(refusal("monday+tuesday", {.first = 3}),
            "--frames: cuts one recording (leave it out, or name one with --traversal)");
  EXPECT_EQ(refusal("monday+tuesday", {.from = 3}),
            "--metres: cuts one recording (leave it out, or name one with --traversal)");
  make_file(folder_ / "short.csv", "1,2,3\n4,5,6\n");
  make_file(folder_ / "short.poses.csv", "x,y\n0,0\n10,0\n");
  EXPECT_EQ(
      refusal("monday+short"),
      "traversal 'monday+short': one has pictures or features that the other lacks (join recordings of one kind)");
  write(std::string(50, 'a'), 4, kEastAndBack, 0);
  EXPECT_TRUE(holds(refusal("monday+tuesday+" + std::string(50, 'a')), "the name may have 64 characters"));
  Corners home = kEastAndBack;
  for (auto& [east, north] : home) east += 53;
  write("odometry", 5, home, 0);
  write("odometry2", 6, home, 0);
  EXPECT_EQ(refusal("odometry+odometry2"),
            "traversal 'odometry+odometry2': each begins at 0, 0 of a plane of its own (join recordings with latitude "
            "and longitude, or in one plane)");
  std::filesystem::remove(folder_ / "monday.poses.csv");
  EXPECT_EQ(refusal("monday+tuesday"),
            "traversal 'monday+tuesday': one of them has no latitude and longitude, and one no places in a plane (join "
            "recordings with latitude and longitude, or in one plane)");
  make_file(folder_ / "monday+tuesday.csv", "1,2\n3,4\n");  // a file may be called so
  EXPECT_EQ(load("monday+tuesday", {}, {}).frames, 2);
}

TEST_F(RecordedStreets, NeedPlacesInAPlaneOrOnTheEarth) {
  std::filesystem::remove(folder_ / "day.poses.csv");
  const std::string missing =
      "traversal 'day': has neither a map of streets nor places in a plane or on the earth (leave out --rule)";
  EXPECT_EQ(refusal(StateRule::kStreet), missing);
  make_file(folder_ / "day.poses.csv", "frame,metres\n0,0\n1,10\n2,20\n");
  EXPECT_EQ(refusal(StateRule::kStreet), missing);
  // On the earth a receiver errs by 5 m: here the way back is 4.4 m beside, frames 1 m apart, at longitude 180.
  std::string poses = "lat,lon\n";
  for (int i = 0; i < 42; ++i) {
    const double east = i < 21 ? i : 41 - i;
    poses += (i < 21 ? "0," : "0.00004,") +
             std::to_string(east < 10 ? 179.99991 + east * 9e-6 : -180 + (east - 10) * 9e-6) + "\n";
  }
  make_file(folder_ / "day.poses.csv", poses);
  EXPECT_GT(load("day", StateRule::kStreet).frames, 20);
}

}  // namespace
}  // namespace citylearn::testing
