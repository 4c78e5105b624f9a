// SPDX-License-Identifier: Apache-2.0
// Several goals one after the other: values by hand, and by trying all ways.
#include "core/task/goal_chain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "core/util/random.h"
#include "tests/support/streets.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// The fewest steps through goals, by following all ways at once: where one may be, and how many goals were reached.
int fewest_by_trial(const StateMap& map, int start, const std::vector<int>& goals) {
  std::set<std::pair<int, std::size_t>> ways{{start, 0}};
  for (int steps = 1; steps < 200; ++steps) {
    std::set<std::pair<int, std::size_t>> on;
    for (const auto& [state, reached] : ways)
      for (std::uint8_t action = 0; action < kActions; ++action) {
        const int to = map.next(state, action);
        if (to >= 0) on.emplace(to, reached + (map.place(to) == goals[reached] ? 1 : 0));
        if (to >= 0 && map.place(to) == goals[reached] && reached + 1 == goals.size()) return steps;
      }
    ways = std::move(on);
  }
  return StateMap::kNoWay;
}

TEST(GoalChain, TheNearestWayToAGoalIsNotAlwaysTheBestForTheNext) {
  //       5
  //   1 - 2 - 3    From place 0, facing 4, two steps lead over 4 to place 2, where one faces 1 then: 4 sees 2 at
  //   |   |        290 degrees. On to 3 it is two turns and a step. Over 1 one arrives a turn later, but faces 3.
  //   0 - 4
  const StreetMap streets{{0, 0, 10, 20, 10, 10},
                          {0, 10, 10, 10, 0, 20},
                          {0, 0, 1, 1, 2, 2, 2, 2, 3, 4, 4, 5},
                          {1, 4, 2, 0, 5, 3, 4, 1, 2, 0, 2, 2},
                          {0, 90, 90, 180, 0, 90, 180, 270, 270, 270, 290, 180}};
  streets.check();
  const StateMap map(streets, StateRule::kStreet, 1 << 20);
  DistanceFields fields(map);
  EXPECT_EQ(map.after(1, kForward, 2), 7) << "at place 2, facing 1";
  EXPECT_EQ(fields.to(2)(1), 2);
  EXPECT_EQ(fields.to(3)(7), 3);
  EXPECT_EQ(fields.to(3)(5), 1) << "at place 2, facing 3";
  const std::vector<int> goals{2, 3};
  EXPECT_EQ(fewest_steps(map, fields, 0, 1, goals), 4) << "neither 2 + 3 nor 2 + 1";
  EXPECT_EQ(fewest_by_trial(map, 1, goals), 4);
}

TEST(GoalChain, ChainsAreAsShortAsTrialSays) {
  constexpr std::uint8_t kTried[] = {kForward, kLeft, kRight};
  Random random(5);
  int shorter = 0;  // chains than their single ways one after the other
  for (int round = 0; round < 60; ++round) {
    StreetMap streets;
    const auto places = static_cast<std::uint32_t>(4 + random.below(5));
    for (std::uint32_t place = 0; place < places; ++place) {
      streets.east.push_back(static_cast<float>(random.below(50)));
      streets.north.push_back(static_cast<float>(random.below(50)));
      std::set<std::uint32_t> ends{(place + 1) % places};
      for (int link = 0; link < 3; ++link) ends.insert(static_cast<std::uint32_t>(random.below(places)));
      ends.erase(place);
      for (const std::uint32_t to : ends) {
        streets.from.push_back(place);
        streets.to.push_back(to);
        streets.heading.push_back(static_cast<float>(random.below(360)));
      }
    }
    streets.put_in_order();
    const StateRule rule = round % 2 ? StateRule::kStreet : StateRule::kStreetFixed;
    const StateMap map(streets, rule, 1 << 20);
    DistanceFields fields(map);
    for (int start = 0; start < map.states(); start += 1 + map.states() / 20) {
      std::vector<int> goals;
      for (int goal = map.place(start); goals.size() < 3;) {
        const int next = static_cast<int>(random.below(places));
        if (next != goal) goals.push_back(goal = next);
      }
      const int fewest = fewest_steps(map, fields, 0, start, goals);
      ASSERT_EQ(fewest, fewest_by_trial(map, start, goals)) << "round " << round << ", from " << start;
      if (rule != StateRule::kStreet) continue;  // where not all can be reached
      int greedy = 0, state = start;
      for (const int goal : goals)
        for (const DistanceField to = fields.to(goal); to(state) > 0; ++greedy)
          state = map.next(state, *std::find_if(std::begin(kTried), std::end(kTried), [&](std::uint8_t action) {
                             const int next = map.next(state, action);
                             return next >= 0 && to(next) < to(state);
                           }));
      shorter += fewest < greedy;
    }
  }
  EXPECT_GT(shorter, 10);
}

TEST(GoalChain, OnALineChainsAddUp) {
  const StateMap map(20);
  DistanceFields fields(map);
  EXPECT_EQ(fewest_steps(map, fields, 0, 8, std::vector{5}), 3);
  EXPECT_EQ(fewest_steps(map, fields, 0, 8, std::vector{5, 15, 14}), 3 + 10 + 1);
}

TEST(GoalChain, GoalsFollowFromStartAndFirstGoal) {
  const StateMap map(small_streets(), StateRule::kStreet, 1 << 20);
  DistanceFields one(map), other(map);
  for (const int first : {1, 2}) {
    const std::vector<int> goals = draw_goals(map, one, 0, first, 6);
    EXPECT_EQ(goals, draw_goals(map, other, 0, first, 6));
    EXPECT_EQ(goals.front(), first);
    ASSERT_EQ(goals.size(), 6u);
    for (std::size_t i = 1; i < goals.size(); ++i) EXPECT_NE(goals[i], goals[i - 1]);
  }
  DistanceFields wide(map, 1000);  // all places are the goal
  EXPECT_TRUE(contains(error_of([&] { draw_goals(map, wide, 0, 1, 2); }), "finds no goal"));
}

}  // namespace
}  // namespace citylearn::testing
