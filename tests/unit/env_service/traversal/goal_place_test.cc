// SPDX-License-Identifier: Apache-2.0
// One place to which all tasks lead.
#include "env_service/traversal/goal_place.h"

#include <gtest/gtest.h>

#include <bit>
#include <set>

#include "env_service/environment.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Frames a thousandth of a degree of latitude apart, 111.195 m; where frame 2 is, is not known.
Traversal northward(int frames) {
  Traversal traversal = small_traversal(frames);
  for (int i = 0; i < frames; ++i) traversal.latitude.push_back(i == 2 ? NAN : 0.001 * i);
  traversal.longitude.assign(static_cast<std::size_t>(frames), 8.5);
  return traversal;
}

std::string refusal(const Traversal& traversal, const std::string& goal) {
  return error_of([&] { with_goal(traversal, goal); });
}

TEST(GoalPlace, IsANumberAPositionOrAPicture) {
  Traversal traversal = northward(6);
  traversal.images = std::make_shared<FakeImages>(6);
  const std::string picture = traversal.images->name(4);
  for (const auto& [goal, place] : std::map<std::string, int>{
           {"0", 0}, {"5", 5}, {"0.00309,8.5", 3}, {"0.0016,8.5,80", 1}, {"0.01,8.5,1000", 5}, {picture, 4}}) {
    const Traversal with = with_goal(traversal, goal);
    EXPECT_EQ(with.goal, place) << goal;
    EXPECT_EQ(with.name, "line-goal" + std::to_string(place));
    EXPECT_EQ(with.hash(), traversal.hash()) << "the recording is the same";
  }
  EXPECT_EQ(with_goal(traversal, "").name, "line");
  EXPECT_EQ(without_goal("line-goal31-slip0.1"), "line-slip0.1");
  EXPECT_EQ(without_goal("line-goalkeeper"), "line-goalkeeper");
}

TEST(GoalPlace, OnStreetsIsThePlaceOfAState) {
  Traversal traversal = streets_traversal();
  for (int state = 0; state < traversal.frames; ++state) {
    traversal.latitude.push_back(0.001 * small_states()->place(state));
    traversal.longitude.push_back(0);
  }
  EXPECT_EQ(with_goal(traversal, "6").goal, 6);
  EXPECT_EQ(with_goal(traversal, "0.00401,0").goal, 4);
  EXPECT_TRUE(contains(refusal(traversal, "7"), "'streets' has the places 0..6"));
  EXPECT_TRUE(contains(refusal(traversal, "0.0069,0"), "the nearest, place 6 at 0.006000,0.000000, is 100.1 m away"));
}

TEST(GoalPlace, IsRefusedInOneLine) {
  Traversal traversal = northward(6);
  for (const auto& [goal, why] : std::map<std::string, std::string>{
           {"6", "'line' has the places 0..5"},
           {"-1", "'line' has the places 0..5"},
           {"1.5", "'line' has the places 0..5"},
           {"1e300", "'line' has the places 0..5"},
           {"0.006,8.5", "no place is within 50 m: the nearest, place 5 at 0.005000,8.500000, is 111.2 m away"},
           {"91,8.5", "is not a latitude and a longitude"},
           {"0,8.5,0", "is not a latitude and a longitude"},
           {"0,8.5,-3", "is not a latitude and a longitude"},
           {"1,2,3,4", "is neither a place's number"},
           {"nan,0", "is neither a place's number"},
           {"1e999,0", "is neither a place's number"},
           {"1,", "is neither a place's number"},
           {"other.png", "is neither a place's number, nor LAT,LON, nor a picture of 'line'"}}) {
    const std::string said = refusal(traversal, goal);
    EXPECT_TRUE(contains(said, why)) << goal << ": " << said;
    EXPECT_TRUE(holds(said, "--goal-place " + goal)) << said;
  }
  traversal.unmatched.assign(6, false);
  traversal.unmatched[3] = true;
  EXPECT_TRUE(contains(refusal(traversal, "3"), "does not show that place"));
  traversal.latitude.clear();
  EXPECT_TRUE(contains(refusal(traversal, "0,8.5"), "latitudes and longitudes of 'line' are not known"));
}

TEST(GoalPlace, AllTasksLeadThere) {
  for (const msg::Mode mode : {msg::TRAIN, msg::EVALUATE})
    for (const bool streets : {false, true}) {
      const Traversal traversal = with_goal(streets ? streets_traversal() : small_traversal(13), "4");
      Environment environment(traversal, 3);
      msg::TaskSettings with = settings(mode, 13, 8);
      with.tasks() = mode == msg::EVALUATE ? 60 : 0;
      environment.reset(with);
      std::multiset<bool> reached;
      std::set<int> starts;
      Random random(1);
      for (msg::Observation seen; reached.size() < 60;) {
        environment.observe(seen);
        std::vector<std::uint8_t> choice;
        for (std::size_t agent = 0; agent < 3; ++agent) {
          const auto drawn = random.below(kActions);
          const std::uint8_t allowed = seen.allowed()[agent];
          choice.push_back(static_cast<std::uint8_t>(allowed >> drawn & 1 ? drawn : std::countr_zero(allowed)));
          if (seen.flags()[agent] & msg::FLAG_IDLE) continue;
          const int position = static_cast<int>(seen.position()[agent]);
          EXPECT_EQ(seen.goal()[agent], 4u);
          EXPECT_NE(streets ? small_states()->place(position) : position, 4) << "no episode begins there";
          EXPECT_EQ(seen.frame()[agent], seen.position()[agent]);
        }
        environment.step(choice);
        for (const Environment::Episode& episode : environment.finished()) {
          reached.insert(episode.completed);
          starts.insert(episode.start);
        }
      }
      EXPECT_GT(reached.count(true), 2u);
      EXPECT_GT(reached.count(false), 5u);
      EXPECT_GT(starts.size(), 8u);
    }
}

TEST(GoalPlace, MustBeOnTheRoute) {
  const Traversal traversal = with_goal(small_traversal(20), "4");
  Environment environment(traversal, 1);
  msg::TaskSettings with = settings(msg::TRAIN, 10, 10);
  environment.reset(with);
  with.first_frame() = 5;
  EXPECT_TRUE(contains(error_of([&] { environment.reset(with); }), "the route 5..14 is without the goal, place 4"));
  // From a place without a way to the goal no task begins.
  Traversal apart = streets_traversal(
      StreetMap{{0, 0, 10, 20}, {0, 10, 10, 10}, {0, 1, 1, 2, 3}, {1, 2, 0, 3, 2}, {0, 90, 180, 90, 270}});
  apart = with_goal(apart, "0");
  Environment streets(apart, 1);
  for (with = settings(msg::EVALUATE, 5, 10); with.seed() < 30; ++with.seed()) {
    streets.reset(with);
    msg::Observation seen;
    streets.observe(seen);
    EXPECT_TRUE(seen.position()[0] == 1 || seen.position()[0] == 2) << "from places 2 and 3 no way leads to 0";
  }
}

}  // namespace
}  // namespace citylearn::testing
