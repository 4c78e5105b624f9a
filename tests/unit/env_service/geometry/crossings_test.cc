// SPDX-License-Identifier: Apache-2.0
// Where a recorded route crosses itself, and ways on the map that this makes.
#include "env_service/geometry/crossings.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <numbers>
#include <numeric>

#include "core/task/route_map.h"
#include "core/util/error.h"
#include "core/util/random.h"
#include "core/wire/messages.h"
#include "env_service/env_service.h"
#include "tests/support/env/env.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// A route drawn in metres, somewhere in the north where degrees of longitude are short.
struct Drawn {
  std::vector<double> x, y;

  void add(double east, double north) {
    x.push_back(east);
    y.push_back(north);
  }
  int frames() const { return static_cast<int>(x.size()); }
  double metres(int a, int b) const {
    return std::hypot(x[static_cast<std::size_t>(a)] - x[static_cast<std::size_t>(b)],
                      y[static_cast<std::size_t>(a)] - y[static_cast<std::size_t>(b)]);
  }
  std::vector<double> latitude() const { return degrees(y, 1, 60); }
  std::vector<double> longitude() const { return degrees(x, std::cos(60 * std::numbers::pi / 180), 10); }
  std::vector<std::vector<int>> junctions(double metres, int spacing = 5) const {
    const std::vector<int> turns = find_turns(latitude(), longitude(), {metres, spacing});
    EXPECT_NO_THROW(check_turns(turns, frames()));
    return junctions_of(turns);
  }

 private:
  static std::vector<double> degrees(const std::vector<double>& metres, double parallel, double origin) {
    std::vector<double> all;
    for (const double one : metres) all.push_back(origin + one / (111195 * parallel));
    return all;
  }
};

struct Point {
  double x, y;
};

/// Along straight lines from point to point, a frame every `step` metres.
Drawn along(const std::vector<Point>& points, double step = 10) {
  Drawn drawn;
  double left = 0;
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const double east = points[i + 1].x - points[i].x, north = points[i + 1].y - points[i].y;
    const double length = std::hypot(east, north);
    double at = left;
    for (; at < length; at += step) drawn.add(points[i].x + east * at / length, points[i].y + north * at / length);
    left = at - length;
  }
  return drawn;
}

TEST(Crossings, AFigureEightHasOne) {
  Drawn drawn;
  for (int i = 0; i < 80; ++i) {
    const double t = std::numbers::pi / 2 + i * (2 * std::numbers::pi - 0.5) / 80;
    drawn.add(200 * std::sin(t), 200 * std::sin(t) * std::cos(t));
  }
  const auto junctions = drawn.junctions(15);
  ASSERT_EQ(junctions.size(), 1u);
  ASSERT_EQ(junctions[0].size(), 2u);
  for (const int place : junctions[0]) EXPECT_LT(std::hypot(drawn.x[place], drawn.y[place]), 12) << place;
  const std::vector<int> turns = find_turns(drawn.latitude(), drawn.longitude(), {15, 5});
  EXPECT_EQ(turns[junctions[0][0]], junctions[0][1]);
  EXPECT_EQ(turns[junctions[0][1]], junctions[0][0]);
}

/// Three streets to the east and three to the north, one after the other without a break.
TEST(Crossings, AGridHasOneAtEachCorner) {
  for (const double start : {-50.0, -53.0}) {
    const Drawn drawn = along({{start, 0},
                               {250, 0},
                               {250, 100},
                               {-50, 100},
                               {-50, 200},
                               {250, 200},
                               {250, 250},
                               {200, 250},
                               {200, -50},
                               {100, -50},
                               {100, 250},
                               {0, 250},
                               {0, -50}});
    const auto junctions = drawn.junctions(10);
    EXPECT_EQ(junctions.size(), 9u);
    for (const std::vector<int>& places : junctions) {
      ASSERT_EQ(places.size(), 2u);
      EXPECT_LT(drawn.metres(places[0], places[1]), 10);
      for (const int place : places) {
        EXPECT_NEAR(drawn.x[place], 100 * std::round(drawn.x[place] / 100), 10);
        EXPECT_NEAR(drawn.y[place], 100 * std::round(drawn.y[place] / 100), 10);
      }
    }
  }
}

TEST(Crossings, StreetsBesideEachOtherHaveNoneOrOne) {
  const Drawn drawn = along({{0, 0}, {300, 0}, {300, 30}, {0, 30}});
  EXPECT_TRUE(drawn.junctions(15).empty()) << "too far from each other";
  EXPECT_EQ(drawn.junctions(40).size(), 1u) << "near all the way: one approach";
}

TEST(Crossings, ALoopDrivenAgainIsJoinedOnce) {
  Drawn twice;
  for (int i = 0; i < 114; ++i) {  // not to the very end, which would be a third time by the beginning
    const double t = 2 * std::numbers::pi * i / 60, radius = i < 60 ? 100 : 102;
    twice.add(radius * std::cos(t), radius * std::sin(t));
  }
  const auto junctions = twice.junctions(15);
  ASSERT_EQ(junctions.size(), 1u);
  EXPECT_NEAR(junctions[0][1] - junctions[0][0], 60, 1);
}

TEST(Crossings, ThreeRoadsAtOneSpotAreACycle) {
  const Drawn drawn = along({{-100, 0}, {100, 0}, {50, 87}, {-50, -87}, {50, -87}, {-50, 87}});
  const auto junctions = drawn.junctions(15);
  ASSERT_EQ(junctions.size(), 1u);
  ASSERT_EQ(junctions[0].size(), 3u);
  const std::vector<int> turns = find_turns(drawn.latitude(), drawn.longitude(), {15, 5});
  int place = junctions[0][0];
  for (int i = 0; i < 3; ++i) place = turns[static_cast<std::size_t>(place)];
  EXPECT_EQ(place, junctions[0][0]);
  EXPECT_NE(turns[static_cast<std::size_t>(place)], place);
}

TEST(Crossings, StandingIsNotComingAgain) {
  Drawn drawn = along({{0, 0}, {100, 0}});
  for (int i = 0; i < 30; ++i) drawn.add(100 + i % 3, i % 2);
  for (int i = 1; i < 10; ++i) drawn.add(100 + 10 * i, 0);
  EXPECT_TRUE(drawn.junctions(10).empty());
}

TEST(Crossings, ARoadIsJoinedAtMostOnceInAFewFrames) {
  // Two roads cross a third within 30 m of each other.
  const Drawn drawn = along({{0, 0}, {300, 0}, {300, 100}, {150, 100}, {150, -100}, {180, -100}, {180, 100}});
  EXPECT_EQ(drawn.junctions(10, 2).size(), 2u);
  EXPECT_EQ(drawn.junctions(10, 5).size(), 1u);
}

TEST(Crossings, UnknownPositionsJoinNothing) {
  const Drawn drawn = along({{-100, 0}, {100, 0}, {100, 100}, {0, 100}, {0, -100}});
  ASSERT_EQ(drawn.junctions(10).size(), 1u);
  std::vector<double> latitude = drawn.latitude(), longitude = drawn.longitude();
  for (int i = 5; i < 15; ++i) latitude[static_cast<std::size_t>(i)] = kUnknown;
  EXPECT_TRUE(find_turns(latitude, longitude, {10, 5}).empty());
  latitude.assign(latitude.size(), kUnknown);
  EXPECT_TRUE(find_turns(latitude, longitude, {10, 5}).empty());
  EXPECT_TRUE(std::isnan(crossing_reach(latitude, longitude)));
  EXPECT_TRUE(find_turns({}, {}, {10, 5}).empty());
}

TEST(Crossings, ReachFollowsTheSteps) {
  const Drawn drawn = along({{0, 0}, {300, 0}}, 4);
  EXPECT_NEAR(crossing_reach(drawn.latitude(), drawn.longitude()), 6, 0.01);
}

TEST(Crossings, RefusesWhatMakesNoSense) {
  EXPECT_THROW(find_turns({1, 2}, {1}, {10, 5}), Error);
  EXPECT_THROW(find_turns({1, 2}, {1, 2}, {0, 5}), Error);
  EXPECT_THROW(find_turns({1, 2}, {1, 2}, {kUnknown, 5}), Error);
  EXPECT_THROW(find_turns({1, 2}, {1, 2}, {10, 0}), Error);
}

TEST(Crossings, AreNotOnTheWireYet) {
  Traversal traversal = small_traversal(4);
  traversal.turns = {2, 1, 0, 3};
  EnvServiceOptions options;
  options.node.session = "crossings-" + std::to_string(getpid());
  options.node.middleware.name = "inprocess";
  EXPECT_TRUE(contains(error_of([&] { run_env_service(options, traversal, [] { return true; }); }), "crosses itself"));
}

TEST(RouteMap, RefusesTurnsThatLoseAPlace) {
  EXPECT_NO_THROW(check_turns({}, 4));
  EXPECT_NO_THROW(check_turns({3, 1, 2, 0}, 4));
  for (const std::vector<int>& bad :
       {std::vector<int>{0, 1, 2}, {3, 1, 2, 3}, {0, 1, 2, 4}, {0, 1, 2, -1}, {0, 1, 2, 3, 4}})
    EXPECT_THROW(check_turns(bad, 4), Error);
}

TEST(RouteMap, AStretchKeepsTheTurnsThatComeBack) {
  //                              0  1  2  3  4  5  6  7
  const std::vector<int> turns = {0, 4, 6, 3, 7, 5, 2, 1};  // 1 -> 4 -> 7 -> 1, 2 <-> 6
  EXPECT_EQ(turns_within(turns, 0, 8), turns);
  EXPECT_EQ(turns_within(turns, 0, 7), (std::vector<int>{0, 4, 6, 3, 1, 5, 2})) << "7 is passed over";
  EXPECT_EQ(turns_within(turns, 2, 5), (std::vector<int>{4, 1, 2, 3, 0})) << "2 <-> 6 alone";
  EXPECT_TRUE(turns_within(turns, 2, 4).empty()) << "nothing comes back";
  EXPECT_TRUE(turns_within({}, 2, 4).empty());
}

/// Finds distances by trying: after k rounds every way of k steps is known.
std::vector<int> distances_by_trying(int goal, int places, const std::vector<int>& turns) {
  std::vector<int> distances(static_cast<std::size_t>(places), places);
  distances[static_cast<std::size_t>(goal)] = 0;
  for (int round = 0; round < places; ++round)
    for (int place = 0; place < places; ++place)
      for (const std::uint8_t action : {kStay, kNext, kPrevious}) {
        const int to = place_after(place, action, turns);
        if (to < 0 || to >= places) continue;
        int& best = distances[static_cast<std::size_t>(place)];
        best = std::min(best, distances[static_cast<std::size_t>(to)] + 1);
      }
  return distances;
}

TEST(RouteMap, DistancesAreTheFewestSteps) {
  Random random{9};
  std::vector<int> found;
  for (int map = 0; map < 20; ++map) {
    const int places = 2 + static_cast<int>(random.below(30));
    std::vector<int> turns(static_cast<std::size_t>(places));
    std::iota(turns.begin(), turns.end(), 0);
    for (int swaps = 0; swaps < map % 5; ++swaps)  // of three places too, where swaps meet
      std::swap(turns[random.below(places)], turns[random.below(places)]);
    for (int goal = 0; goal < places; ++goal) {
      distances_to(goal, places, turns, found);
      EXPECT_EQ(found, distances_by_trying(goal, places, turns));
      distances_to(goal, places, {}, found);
      for (int place = 0; place < places; ++place)
        EXPECT_EQ(found[static_cast<std::size_t>(place)], std::abs(goal - place));
    }
  }
}

}  // namespace
}  // namespace citylearn::testing
