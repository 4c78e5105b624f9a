// SPDX-License-Identifier: Apache-2.0
// The task on streets.
#include <gtest/gtest.h>

#include "core/task/path.h"
#include "env_service/environment.h"
#include "tests/support/env/env.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Ten metres to the north and ten to the east, both ways. States: 0 at place 0, 1 to the east and 2 to the south at
/// place 1, 3 at place 2, a dead end.
///   1 - 2
///   0
Traversal corner_traversal() {
  Traversal traversal = small_traversal(4);
  StreetMap streets{{0, 0, 10}, {0, 10, 10}, {0, 1, 1, 2}, {1, 2, 0, 1}, {0, 90, 180, 270}};
  streets.put_in_order();
  traversal.streets = std::make_shared<const StreetMap>(streets);
  traversal.rule = StateRule::kStreet;
  return traversal;
}

/// Begins the first task of one agent that starts in state 0 with its goal at place 2.
Environment begin_at_the_south(const Traversal& traversal, msg::TaskSettings with) {
  for (with.seed() = 0; with.seed() < 1000; ++with.seed()) {
    Environment environment(traversal, 1);
    environment.reset(with);
    msg::Observation seen;
    environment.observe(seen);
    if (seen.position()[0] == 0 && seen.goal()[0] == 2) return environment;
  }
  throw Error("no such task");
}

msg::Observation step(Environment& environment, std::uint8_t action) {
  environment.step(std::span(&action, 1));
  msg::Observation seen;
  environment.observe(seen);
  return seen;
}

TEST(EnvironmentStreets, WalksToAPlaceInTheFewestSteps) {
  const Traversal traversal = corner_traversal();
  Environment environment = begin_at_the_south(traversal, settings(msg::EVALUATE, 4, 100));
  EXPECT_TRUE(holds(error_of([&] { step(environment, kLeft); }), "action 0 is not allowed at frame 0"));
  const msg::Observation seen = step(environment, kForward);
  EXPECT_EQ(seen.position()[0], 1u);
  EXPECT_EQ(seen.frame()[0], 1u);
  EXPECT_EQ(seen.features(), (std::vector<float>{1, 1.5f}));
  EXPECT_EQ(seen.allowed()[0], 7);
  EXPECT_EQ(seen.reward()[0], 0);
  EXPECT_EQ(step(environment, kForward).reward()[0], 1);
  ASSERT_EQ(environment.finished().size(), 1u);
  const Environment::Episode& episode = environment.finished()[0];
  EXPECT_TRUE(episode.completed);
  EXPECT_EQ(episode.start, 0);
  EXPECT_EQ(episode.goal, 2);
  EXPECT_EQ(episode.shortest, 2);
  EXPECT_EQ(action_at(episode.path, 0), kForward);
  EXPECT_EQ(action_at(episode.path, 1), kForward);
}

TEST(EnvironmentStreets, AnEpisodeMayBeLimitedByItsFewestSteps) {
  const Traversal traversal = corner_traversal();
  msg::TaskSettings with = settings(msg::EVALUATE, 4, 100);
  with.max_detour() = 3;
  Environment environment = begin_at_the_south(traversal, with);
  step(environment, kForward);
  for (int turn = 0; turn < 5; ++turn) {
    EXPECT_TRUE(environment.finished().empty());
    EXPECT_EQ(step(environment, kRight).position()[0] > 2, false);
  }
  ASSERT_EQ(environment.finished().size(), 1u) << "3 x 2 steps";
  EXPECT_FALSE(environment.finished()[0].completed);
}

TEST(EnvironmentStreets, AGoalMayReachAround) {
  // A street to the north: places 10 m apart, 0 to 3.
  Traversal traversal = small_traversal(6);
  StreetMap streets{{0, 0, 0, 0}, {0, 10, 20, 30}, {0, 1, 1, 2, 2, 3}, {1, 2, 0, 3, 1, 2}, {0, 0, 180, 0, 180, 180}};
  streets.put_in_order();
  traversal.streets = std::make_shared<const StreetMap>(streets);
  traversal.rule = StateRule::kStreet;
  msg::TaskSettings with = settings(msg::EVALUATE, 6, 100);
  with.goal_radius() = 10;  // of place 2: places 1 and 3 too
  Environment environment = begin_at_the_south(traversal, with);
  EXPECT_EQ(step(environment, kForward).reward()[0], 1);
  EXPECT_EQ(environment.finished()[0].shortest, 1);
  with.goal_radius() = 30;
  EXPECT_TRUE(holds(error_of([&] { environment.reset(with); }), "finds no goal that can be reached"));
}

/// From places 2 and 3, in the east, nothing leads back to 0 and 1: agents stand there in states 3 and 4.
Traversal one_way_traversal() {
  Traversal traversal = small_traversal(5);
  StreetMap streets{{0, 0, 30, 40}, {0, 10, 10, 10}, {0, 1, 1, 2, 3}, {1, 0, 2, 3, 2}, {0, 90, 180, 90, 270}};
  streets.put_in_order();
  traversal.streets = std::make_shared<const StreetMap>(streets);
  traversal.rule = StateRule::kStreet;
  return traversal;
}

TEST(EnvironmentStreets, AgentsBeginElsewhereWhereNoGoalCanBeReached) {
  const Traversal traversal = one_way_traversal();
  Environment environment(traversal, 1);
  msg::TaskSettings with = settings(msg::TRAIN, 5, 100);
  with.goal_radius() = 10;  // who stands at place 2 or 3 is at the other one already
  environment.reset(with);
  msg::Observation seen;
  Random random(1);
  int begun = 0;
  for (int step = 0; step < 300; ++step) {
    environment.observe(seen);
    if (seen.flags()[0] & msg::FLAG_FIRST) {
      ++begun;
      EXPECT_LT(seen.position()[0], 3u);
    }
    std::uint8_t choice;
    do choice = static_cast<std::uint8_t>(random.below(kActions));
    while (!(seen.allowed()[0] >> choice & 1));
    environment.step(std::span(&choice, 1));
  }
  EXPECT_GT(begun, 20);
}

TEST(EnvironmentStreets, AgentsAreCarriedToWhereTheyCanReachTheirGoal) {
  const Traversal traversal = one_way_traversal();
  Imperfections imperfections;
  imperfections.kidnappings = 1;
  imperfections.slip = 0.1;
  Environment environment(traversal, 8, imperfections);
  msg::TaskSettings with = settings(msg::EVALUATE, 4, 100);
  with.frames() = 5;
  with.tasks() = 200;
  environment.reset(with);
  msg::Observation seen;
  Random random(1);
  int ended = 0;
  for (std::vector<std::uint8_t> choice(8); !environment.done(); environment.step(choice)) {
    for (const Environment::Episode& episode : environment.finished()) ended += episode.completed;
    environment.observe(seen);
    for (std::size_t agent = 0; agent < choice.size(); ++agent) {
      // To a goal in the west only agents in the west come.
      const bool west = !(seen.flags()[agent] & msg::FLAG_IDLE) && seen.goal()[agent] < 2;
      EXPECT_TRUE(!west || seen.position()[agent] < 3);
      do choice[agent] = static_cast<std::uint8_t>(random.below(kActions));
      while (!(seen.allowed()[agent] >> choice[agent] & 1) ||
             (seen.goal()[agent] < 2 && seen.position()[agent] == 2 && choice[agent] == kForward));
    }
  }
  EXPECT_GT(ended, 150);
}

TEST(EnvironmentStreets, WrongSettingsAreSaid) {
  Traversal traversal = corner_traversal();
  Environment environment(traversal, 1);
  msg::TaskSettings with = settings(msg::TRAIN, 4, 100);
  with.shuffle() = true;
  EXPECT_TRUE(holds(error_of([&] { environment.reset(with); }), "TaskSettings.shuffle: the frames of streets"));
  with = settings(msg::TRAIN, 3, 100);
  EXPECT_TRUE(holds(error_of([&] { environment.reset(with); }), "TaskSettings.frames: the streets of 'line' are one"));
  traversal.frames = 3;
  EXPECT_TRUE(holds(error_of([&] { Environment(traversal, 1); }), "has 3 frames for 4 states"));
}

}  // namespace
}  // namespace citylearn::testing
