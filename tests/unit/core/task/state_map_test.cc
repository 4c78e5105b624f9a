// SPDX-License-Identifier: Apache-2.0
// States of street maps: by each rule, on maps drawn by hand and on the published graph of Manhattan.
#include "core/task/state_map.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <functional>
#include <map>
#include <sstream>
#include <string>

#include "tests/paths.h"
#include "tests/support/data/real_data.h"
#include "tests/support/text.h"

namespace citylearn {
namespace {

constexpr std::size_t kMost = 1 << 20;

/// A street to the north, a corner, and a street to the east, 10 m each: 2 is a dead end.
///   1 - 2
///   0
StreetMap corner() {
  StreetMap map{{0, 0, 10}, {0, 10, 10}, {1, 0, 2, 1}, {0, 1, 1, 2}, {180, 720, -90, 90}};
  // In order: 0 -> 1 at 0, 1 -> 2 at 90, 1 -> 0 at 180, 2 -> 1 at 270.
  EXPECT_EQ(map.put_in_order(), (std::vector<std::uint32_t>{1, 3, 0, 2}));
  return map;
}

TEST(StateMap, FacesLinksOnStreets) {
  const StreetMap streets = corner();
  EXPECT_EQ(streets.heading, (std::vector<float>{0, 90, 180, 270}));
  const StateMap map(streets, StateRule::kStreet, kMost);
  ASSERT_EQ(map.states(), 4);
  EXPECT_EQ(map.places(), 3);
  EXPECT_EQ(map.place(2), 1);
  EXPECT_EQ(map.next(0, kForward), 1);  // follows the bend
  EXPECT_EQ(map.next(1, kForward), 3);  // turned round at the dead end
  EXPECT_EQ(map.next(2, kForward), 0);
  EXPECT_EQ(map.next(3, kForward), 2);
  EXPECT_EQ(map.next(1, kLeft), 2);
  EXPECT_EQ(map.next(1, kRight), 2);
  EXPECT_EQ(map.allowed(0), 1u << kForward);
  EXPECT_EQ(map.allowed(1), 7u);
  EXPECT_EQ(map.after(0, kForward, 2), 3);
  EXPECT_EQ(map.after(3, kLeft, 2), 3);
  EXPECT_EQ(map.steps_to({0}), (std::vector<std::uint16_t>{0, 2, 1, 2}));
  EXPECT_EQ(map.steps_to({0, 2}), (std::vector<std::uint16_t>{0, 1, 1, 0}));
}

TEST(StateMap, TurnsBySixteenthsAtFixedHeadings) {
  const StateMap map(corner(), StateRule::kStreetFixed, kMost);
  ASSERT_EQ(map.states(), 48);
  const auto at = [](int place, int heading) { return 16 * place + heading; };
  EXPECT_EQ(map.heading(at(1, 4)), 90);
  EXPECT_EQ(map.next(at(0, 0), kForward), at(1, 0));
  EXPECT_EQ(map.next(at(0, 1), kForward), at(1, 1));  // 22.5 degrees beside the link
  EXPECT_EQ(map.next(at(0, 2), kForward), -1);        // 45
  EXPECT_EQ(map.next(at(0, 0), kLeft), at(0, 15));
  EXPECT_EQ(map.next(at(0, 15), kRight), at(0, 0));
  // North along the street, three turns to the right, the third lets it go east.
  EXPECT_EQ(map.steps_to({2})[static_cast<std::size_t>(at(0, 0))], 5);
}

TEST(StateMap, GoesToTheNearestPlaceAsStreetLearnDoes) {
  // Links lead 0 -> 1 -> 2 -> 3 -> 4, and back, whatever their headings say; 2 and 3 lie nearer to 0 than 1 does.
  // 5 is at the spot of 0.
  StreetMap streets{{0, 0, 0, 0, 0, 0},
                    {0, 30, 10, 20, 5, 0},
                    {0, 1, 1, 2, 2, 3, 3, 4, 0, 5},
                    {1, 0, 2, 1, 3, 2, 4, 3, 5, 0},
                    {90, 90, 90, 90, 90, 90, 90, 90, 0, 0}};
  streets.put_in_order();
  const StateMap map(streets, StateRule::kStreetLearn, kMost);
  EXPECT_EQ(map.next(0, kForward), 2 * 16);       // the nearest within three links; 4 is four away
  EXPECT_EQ(map.next(16 * 5, kForward), 2 * 16);  // 5 -> 0 -> 1 -> 2: three links
  EXPECT_EQ(map.next(16 * 3, kForward), 16);
  EXPECT_EQ(map.next(4, kForward), -1);  // nothing in the east
  EXPECT_EQ(map.starts(), (std::vector<int>{0, 16, 32, 48, 64, 80}));
  EXPECT_EQ(map.places_around(0, 10), (std::vector<int>{0, 2, 4, 5}));
}

TEST(StateMap, OneWayLinksAreOneWay) {
  // A square walked one way round: 0 -> 1 -> 2 -> 3 -> 0.
  StreetMap streets{{0, 0, 10, 10}, {0, 10, 10, 0}, {0, 1, 2, 3}, {1, 2, 3, 0}, {0, 90, 180, 270}};
  streets.put_in_order();
  const StateMap map(streets, StateRule::kStreet, kMost);
  EXPECT_EQ(map.steps_to({0}), (std::vector<std::uint16_t>{0, 3, 2, 1}));
}

TEST(StateMap, GoalsWithoutAWayAreSaid) {
  // Two places that lead to two others, from which nothing leads back.
  StreetMap streets{{0, 0, 10, 20}, {0, 10, 10, 10}, {0, 1, 1, 2, 3}, {1, 0, 2, 3, 2}, {0, 180, 90, 90, 270}};
  streets.put_in_order();
  const StateMap map(streets, StateRule::kStreet, kMost);
  DistanceFields fields(map);
  EXPECT_TRUE(fields.to(3).reaches(0));
  EXPECT_FALSE(fields.to(0).reaches(4));
  EXPECT_EQ(fields.to(0)(0), 0);
}

TEST(StateMap, ALineIsItsPlaces) {
  const StateMap map(5);
  EXPECT_EQ(map.states(), 5);
  EXPECT_EQ(map.place(3), 3);
  EXPECT_EQ(map.allowed(0), 1u << kStay | 1u << kNext);
  EXPECT_EQ(map.allowed(4), 1u << kStay | 1u << kPrevious);
  EXPECT_EQ(map.after(3, kNext, 2), 4);
  EXPECT_EQ(DistanceFields(map).to(1)(4), 3);
}

TEST(StreetMap, WrongMapsEndInOneLine) {
  const auto wrong = [](const std::function<void(StreetMap&)>& change, const std::string& told) {
    StreetMap map = corner();
    change(map);
    EXPECT_TRUE(testing::holds(testing::error_of([&] { map.put_in_order(); }), told));
  };
  wrong([](auto& map) { map.to[1] = 3; }, "link 1: from place 1 to 3 of 3");
  wrong([](auto& map) { map.to[1] = 1; }, "leads from place 1 to itself");
  wrong([](auto& map) { map.heading[2] = NAN; }, "link 2: its heading");
  wrong([](auto& map) { map.north[2] = INFINITY; }, "place 2: its position");
  wrong([](auto& map) { map.to.pop_back(); }, "differ in length");
  wrong([](auto& map) { map.from.clear(), map.to.clear(), map.heading.clear(); }, "has no links");
  wrong([](auto& map) { map.from.pop_back(), map.to.pop_back(), map.heading.pop_back(); },
        "leads to place 2, which no link leaves");
  wrong(
      [](auto& map) {
        map.from.insert(map.from.end(), 255, 0), map.to.insert(map.to.end(), 255, 1),
            map.heading.insert(map.heading.end(), 255, 5);
      },
      "place 0: has more than 255 links");
  EXPECT_TRUE(testing::holds(testing::error_of([] { StateMap(corner(), StateRule::kStreetFixed, 47); }),
                             "has 48 states, more than 47"));
}

class Manhattan : public ::testing::Test {
 protected:
  void SetUp() override {
    const std::string folder = testing::real_data(CITYLEARN_SOURCE_DIR, "manhattan-graph");
    if (folder.empty()) GTEST_SKIP() << "no graph of Manhattan";
    std::string row, field;
    std::ifstream nodes(folder + "/nodes.txt"), links(folder + "/links.txt");
    const auto fields = [&] {
      std::vector<std::string> found;
      for (std::istringstream text(row); std::getline(text, field, ',');) found.push_back(field);
      return found;
    };
    while (std::getline(nodes, row)) {
      const auto node = fields();
      places_.emplace(node[0], static_cast<int>(places_.size()));
      constexpr double kMetres = 111195;
      streets_.east.push_back(static_cast<float>((std::stod(node[3]) + 74) * kMetres * std::cos(40.75 / 57.29578)));
      streets_.north.push_back(static_cast<float>((std::stod(node[2]) - 40.75) * kMetres));
    }
    while (std::getline(links, row)) {
      const auto link = fields();
      streets_.from.push_back(static_cast<std::uint32_t>(places_.at(link[0])));
      streets_.to.push_back(static_cast<std::uint32_t>(places_.at(link[2])));
      streets_.heading.push_back(std::stof(link[1]));
    }
    for (std::ifstream routes(folder + "/human-routes.csv"); std::getline(routes, row);) {
      std::vector<int> route;
      const auto ids = fields();
      for (std::size_t i = 1; i < ids.size(); ++i) route.push_back(places_.at(ids[i]));
      routes_.push_back(route);
    }
  }
  std::map<std::string, int> places_;
  StreetMap streets_;
  std::vector<std::vector<int>> routes_;
};

TEST_F(Manhattan, PeopleNeverWalkedLessThanTheFewestSteps) {
  const auto begin = std::chrono::steady_clock::now();
  streets_.put_in_order();
  const StateMap map(streets_, StateRule::kStreet, kMost);
  RecordProperty(
      "map_ms",
      std::to_string(std::chrono::duration<double, std::milli>(std::chrono::steady_clock::now() - begin).count()));
  ASSERT_EQ(map.places(), 29641);
  ASSERT_EQ(map.states(), 61319);
  ASSERT_EQ(routes_.size(), 100u);
  double people = 0, fewest = 0;
  int as_short = 0;
  for (const std::vector<int>& route : routes_) {
    const std::vector<std::uint16_t> to = map.steps_to({route.back()});
    int best = StateMap::kNoWay, walked = StateMap::kNoWay;  // of one who faces the first link at the start
    for (int start = 0; start < map.states(); ++start) {
      if (map.place(start) != route.front()) continue;
      int state = start, steps = 0;
      for (std::size_t i = 1; i < route.size(); ++i) {
        int turns = 0;
        const auto leads = [&](int at) { return map.place(map.next(at, kForward)) == route[i]; };
        // To the nearer side: the number of turns to a link that leads on.
        int left = state, right = state;
        while (!leads(left) && !leads(right) && turns < 5) {
          left = map.after(left, kLeft, 1);
          right = map.after(right, kRight, 1);
          ++turns;
        }
        ASSERT_LT(turns, 5) << "no link leads on";
        state = map.next(leads(left) ? left : right, kForward);
        steps += turns + 1;
      }
      if (steps < walked) best = to[static_cast<std::size_t>(start)];
      walked = std::min(walked, steps);
    }
    EXPECT_GE(walked, best);
    as_short += walked == best;
    people += walked;
    fewest += best;
  }
  // Found by a breadth-first search in Python before: 34.0 and 22.7 steps, 44 routes the shortest.
  EXPECT_NEAR(people / 100, 34.0, 0.05);
  EXPECT_NEAR(fewest / 100, 22.7, 0.05);
  EXPECT_EQ(as_short, 44);
}

TEST_F(Manhattan, EveryPlaceIsReachedFromEverywhere) {
  streets_.put_in_order();
  for (const StateRule rule : {StateRule::kStreet, StateRule::kStreetFixed}) {
    const StateMap map(streets_, rule, kMost);
    const std::vector<std::uint16_t> steps = map.steps_to({17});
    EXPECT_EQ(std::count(steps.begin(), steps.end(), StateMap::kNoWay), 0);
  }
}

}  // namespace
}  // namespace citylearn
