// SPDX-License-Identifier: Apache-2.0
#include "env_service/environment.h"

#include <gtest/gtest.h>

#include <map>
#include <set>

#include "tests/support/env/env.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// One agent, walked by hand.
class Walk {
 public:
  Walk(const Traversal& traversal, const msg::TaskSettings& with) : environment(traversal, 1) {
    environment.reset(with);
    environment.observe(seen);
  }
  void step(std::uint8_t action) {
    environment.step(std::span(&action, 1));
    environment.observe(seen);
  }
  float reward_of(std::uint8_t action) {
    step(action);
    return seen.reward()[0];
  }
  int position() const { return static_cast<int>(seen.position()[0]); }
  int goal() const { return static_cast<int>(seen.goal()[0]); }
  std::uint8_t towards() const { return position() < goal() ? kNext : kPrevious; }

  Environment environment;
  msg::Observation seen;
};

/// First seed whose agent starts at `start` with its goal at `goal`.
msg::TaskSettings beginning(const Traversal& traversal, msg::TaskSettings with, int start, int goal) {
  for (std::uint64_t seed = 0; seed < 100000; ++seed) {
    with.seed() = seed;
    const Walk walk(traversal, with);
    if (walk.position() == start && walk.goal() == goal) return with;
  }
  throw Error("no such beginning");
}

TEST(EnvironmentWait, AnAgentWaitsAtTheStartOfItsEpisodeAlone) {
  const Traversal traversal = small_traversal(20);
  const msg::TaskSettings with = settings(msg::TRAIN, 20, 100);
  Walk waiting(traversal, with), going(traversal, with);
  msg::Observation before = waiting.seen;
  waiting.step(kNoAction);
  before.step() = 1;
  EXPECT_EQ(waiting.seen, before) << "nothing of it changes";
  while (!(going.seen.flags()[0] & msg::FLAG_TERMINATED)) {
    EXPECT_EQ(waiting.reward_of(waiting.towards()), going.reward_of(going.towards()));
    EXPECT_EQ(waiting.seen.goal(), going.seen.goal()) << "it draws the same numbers";
    if (going.seen.flags()[0] & msg::FLAG_FIRST) break;
    EXPECT_THROW(waiting.step(kNoAction), Error) << "in the middle of an episode";
  }
}

TEST(EnvironmentMask, ForbidsLeavingTheRouteAtBothEnds) {
  const Traversal traversal = small_traversal(20);
  msg::TaskSettings with = settings(msg::TRAIN, 5, 100);
  with.first_frame() = 10;
  Environment environment(traversal, 16);
  environment.reset(with);
  msg::Observation seen;
  std::set<std::uint32_t> places;
  std::vector<std::uint8_t> choice(16);
  Random random(3);
  for (int tick = 0; tick < 300; ++tick) {
    environment.observe(seen);
    for (int agent = 0; agent < 16; ++agent) {
      const std::uint32_t place = seen.position()[agent];
      places.insert(place);
      EXPECT_EQ(seen.allowed()[agent], place == 10 ? 0b011 : place == 14 ? 0b101 : 0b111) << "at " << place;
      do choice[agent] = static_cast<std::uint8_t>(random.below(3));
      while (!(seen.allowed()[agent] >> choice[agent] & 1));
    }
    environment.step(choice);
  }
  EXPECT_EQ(places, (std::set<std::uint32_t>{10, 11, 12, 13, 14})) << "every place of the route and no other";
}

TEST(EnvironmentMask, RefusesMaskedAndUnknownActionsAndChangesNothing) {
  const Traversal traversal = small_traversal(8);
  Walk walk(traversal, beginning(traversal, settings(msg::TRAIN, 8, 20), 0, 5));
  for (const int bad : {int{kPrevious}, 3, kNoAction - 1}) {
    const msg::Observation before = walk.seen;
    EXPECT_THROW(walk.step(static_cast<std::uint8_t>(bad)), Error) << bad;
    walk.environment.observe(walk.seen);
    EXPECT_EQ(before.step(), walk.seen.step());
    EXPECT_EQ(before.position(), walk.seen.position());
  }
  const std::vector<std::uint8_t> two{kStay, kStay};
  EXPECT_THROW(walk.environment.step(two), Error);
}

TEST(EnvironmentMask, OneBadActionStopsTheWholeTick) {
  const Traversal traversal = small_traversal(8);
  Environment environment(traversal, 2);
  environment.reset(settings(msg::TRAIN, 8, 20));
  msg::Observation before, after;
  environment.observe(before);
  const std::vector<std::uint8_t> choice{before.position()[0] > 0 ? kPrevious : kNext, 3};
  EXPECT_THROW(environment.step(choice), Error);
  environment.observe(after);
  EXPECT_EQ(before.position(), after.position());
}

TEST(EnvironmentEpisode, IsCutAtTheStepLimit) {
  const Traversal traversal = small_traversal(10);
  Walk walk(traversal, beginning(traversal, settings(msg::TRAIN, 10, 6), 0, 9));
  for (int i = 0; i < 5; ++i) {
    walk.step(kStay);
    EXPECT_EQ(walk.seen.flags()[0], 0);
    EXPECT_EQ(walk.seen.previous_action()[0], kStay);
  }
  walk.step(kNext);
  EXPECT_EQ(walk.seen.flags()[0], msg::FLAG_TRUNCATED | msg::FLAG_FIRST);
  ASSERT_EQ(walk.environment.finished().size(), 1u);
  EXPECT_FALSE(walk.environment.finished()[0].completed);
  EXPECT_EQ(walk.environment.finished()[0].steps, 6);
  EXPECT_EQ(walk.position(), 1) << "it stays where the last episode ended";
  walk.step(kStay);
  EXPECT_TRUE(walk.environment.finished().empty()) << "told once";
}

TEST(EnvironmentEpisode, GoalAtTheLastAllowedStepCounts) {
  const Traversal traversal = small_traversal(10);
  Walk walk(traversal, beginning(traversal, settings(msg::TRAIN, 10, 3), 2, 5));
  for (int i = 0; i < 3; ++i) walk.step(kNext);
  EXPECT_EQ(walk.seen.flags()[0], msg::FLAG_TERMINATED | msg::FLAG_FIRST);
  EXPECT_TRUE(walk.environment.finished().at(0).completed);
}

TEST(EnvironmentEpisode, NextOneStartsWhereTheLastEndedWithAnotherGoal) {
  const Traversal traversal = small_traversal(6);
  Walk walk(traversal, settings(msg::TRAIN, 6, 12));
  std::map<int, int> goals;
  for (int episode = 0; episode < 600; ++episode) {
    EXPECT_NE(walk.position(), walk.goal());
    ++goals[walk.goal()];
    const int goal = walk.goal();
    while (walk.environment.finished().empty()) walk.step(walk.towards());
    EXPECT_EQ(walk.position(), goal);
    walk.step(kStay);
  }
  EXPECT_EQ(goals.size(), 6u);
  for (const auto& [goal, count] : goals) EXPECT_NEAR(count, 100, 40) << "goal " << goal;
}

TEST(EnvironmentRoute, RefusesSettingsThatDoNotFit) {
  const Traversal traversal = small_traversal(50);
  Environment environment(traversal, 1);
  const auto refused = [&](auto change, const std::string& field) {
    msg::TaskSettings with = settings(msg::EVALUATE, 10, 16);
    change(with);
    EXPECT_TRUE(error_of([&] { environment.reset(with); }).starts_with("TaskSettings." + field));
  };
  refused([](auto& s) { s.frames() = 51; }, "frames");
  refused([](auto& s) { s.frames() = 1; }, "frames");
  refused([](auto& s) { s.first_frame() = 41; }, "frames");
  refused([](auto& s) { s.first_frame() = 0xFFFFFFFF; }, "frames");
  refused([](auto& s) { s.frames() = 0xFFFFFFFF; }, "frames");
  refused([](auto& s) { s.max_steps() = 0; }, "max_steps");
  refused([](auto& s) { s.max_steps() = 0x80000000; }, "max_steps");
  refused([](auto& s) { s.tasks() = 0; }, "tasks");
  refused([](auto& s) { s.tasks() = 0x80000000; }, "tasks");
  refused([](auto& s) { s.first_task() = 1u << 30; }, "first_task");
  refused([](auto& s) { s.task_mode() = msg::IDLE; }, "task_mode");
}

TEST(EnvironmentRoute, RefusesAgentsThatDoNotFit) {
  const Traversal traversal = small_traversal(50);
  EXPECT_THROW(Environment(traversal, 0), Error);
  EXPECT_THROW(Environment(traversal, 257), Error);
  EXPECT_NO_THROW(Environment(traversal, 256));
}

TEST(EnvironmentRoute, FeaturesThatFitNoObservationAreSeenByReferenceOnly) {
  Traversal wide = small_traversal(2);
  wide.dimension = 4096;
  wide.features.resize(2 * 4096);
  msg::TaskSettings with = settings(msg::TRAIN, 2, 16);
  Environment fits(wide, 64), too_many(wide, 65);
  EXPECT_NO_THROW(fits.reset(with));
  EXPECT_TRUE(error_of([&] {
                too_many.reset(with);
              }).starts_with("TaskSettings.by_reference: the features of 65 agents x 4096"));
  with.by_reference() = true;
  msg::Observation seen, whole;
  too_many.reset(with);
  too_many.observe(seen);
  EXPECT_TRUE(seen.by_reference());
  EXPECT_EQ(seen.frame().size(), 65u);
  // But for the features, what is seen is the same.
  fits.observe(whole);
  EXPECT_EQ(whole.features().size(), 64u * 4096);
  EXPECT_FALSE(whole.by_reference());
  fits.reset(with);
  fits.observe(seen);
  EXPECT_EQ(seen.feature_dimension(), 0u);
  EXPECT_TRUE(seen.features().empty());
  EXPECT_EQ(seen.frame(), whole.frame());
  EXPECT_EQ(seen.goal(), whole.goal());
}

TEST(EnvironmentObservation, NamesSettingsTraversalAndHash) {
  const Traversal traversal = small_traversal(8);
  Walk walk(traversal, settings(msg::TRAIN, 8, 20));
  EXPECT_EQ(walk.seen.settings().version(), 1u);
  EXPECT_EQ(walk.seen.settings().incarnation(), 1u);
  EXPECT_EQ(std::string(walk.seen.traversal().c_str()), "line");
  EXPECT_EQ(walk.seen.traversal_hash(), traversal.hash());
  EXPECT_EQ(walk.seen.feature_dimension(), 2u);
  EXPECT_EQ(walk.seen.step(), 0u);
  EXPECT_EQ(walk.seen.flags()[0], msg::FLAG_FIRST);
  walk.step(kStay);
  EXPECT_EQ(walk.seen.step(), 1u);
  EXPECT_EQ(walk.seen.flags()[0], 0);
}

TEST(EnvironmentPath, IsEveryActionOfTheEpisode) {
  const Traversal traversal = small_traversal(10);
  Walk walk(traversal, beginning(traversal, settings(msg::TRAIN, 10, 40), 3, 6));
  const std::vector<std::uint8_t> actions{kPrevious, kStay, kNext, kNext, kStay, kNext, kNext};
  for (const std::uint8_t action : actions) walk.step(action);
  ASSERT_EQ(walk.environment.finished().size(), 1u);
  // 2 bits each, the first in the lowest bits of the first octet.
  EXPECT_EQ(
      walk.environment.finished()[0].path,
      (std::vector<std::uint8_t>{kPrevious | kStay << 2 | kNext << 4 | kNext << 6, kStay | kNext << 2 | kNext << 4}));
  walk.step(walk.towards());
  while (walk.environment.finished().empty()) walk.step(walk.towards());
  EXPECT_EQ(walk.environment.finished()[0].path.size(),
            static_cast<std::size_t>(walk.environment.finished()[0].steps + 3) / 4)
      << "the next one's begins anew";
}

TEST(EnvironmentPath, IsLeftOutWhereItDoesNotFit) {
  const Traversal traversal = small_traversal(10);
  for (const std::uint32_t steps : {4 * msg::MAX_PATH, 4 * msg::MAX_PATH + 1}) {
    Walk walk(traversal, settings(msg::TRAIN, 10, steps));
    for (std::uint32_t i = 0; i < steps; ++i) walk.environment.step(std::vector<std::uint8_t>{kStay});
    ASSERT_EQ(walk.environment.finished().size(), 1u);
    EXPECT_EQ(walk.environment.finished()[0].path.size(), steps == 4 * msg::MAX_PATH ? msg::MAX_PATH : 0u);
  }
}

TEST(EnvironmentScene, TellsWhereAgentsAreWhereTheyCameFromAndWhereTheyGo) {
  const Traversal traversal = small_traversal(20);
  msg::TaskSettings with = settings(msg::TRAIN, 10, 40);
  with.first_frame() = 5;
  with.shuffle() = true;
  Environment environment(traversal, 3);
  environment.reset(with);
  msg::Observation first, seen;
  environment.observe(first);
  std::vector<std::uint8_t> choice(3);
  for (std::size_t agent = 0; agent < 3; ++agent) choice[agent] = first.position()[agent] > 5 ? kPrevious : kNext;
  environment.step(choice);
  environment.observe(seen);
  msg::Scene scene;
  environment.observe(scene);
  EXPECT_EQ(scene.step(), 1u);
  EXPECT_EQ(scene.frame(), seen.frame());
  EXPECT_EQ(scene.position(), seen.position());
  EXPECT_EQ(scene.goal(), seen.goal());
  EXPECT_EQ(scene.flags(), seen.flags());
  EXPECT_NE(scene.frame(), scene.position()) << "shuffled";
  for (std::size_t agent = 0; agent < 3; ++agent) {
    const bool ended = seen.flags()[agent] & msg::FLAG_FIRST;
    EXPECT_EQ(scene.start()[agent], ended ? seen.position()[agent] : first.position()[agent]);
    EXPECT_EQ(scene.steps()[agent], ended ? 0u : 1u);
  }
}

TEST(Environment, NoTaskBeginsOrEndsWhereAPlaceIsNotShown) {
  Traversal traversal = small_traversal(6);
  traversal.unmatched = {true, false, false, true, true, false};
  Environment environment(traversal, 4);
  std::set<int> begins, goals;
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    environment.reset(settings(msg::EVALUATE, 6, 20, seed));
    msg::Observation observation;
    environment.observe(observation);
    for (int agent = 0; agent < 4; ++agent) {
      begins.insert(static_cast<int>(observation.position()[static_cast<std::size_t>(agent)]));
      goals.insert(environment.goal(agent));
      EXPECT_NE(environment.goal(agent), static_cast<int>(observation.position()[static_cast<std::size_t>(agent)]));
    }
  }
  EXPECT_EQ(begins, (std::set<int>{1, 2, 5}));
  EXPECT_EQ(goals, begins);
  EXPECT_EQ(
      error_of([&] {
        msg::TaskSettings end = settings(msg::TRAIN, 3, 20);
        end.first_frame() = 3;
        environment.reset(end);
      }),
      "TaskSettings.frames: traversal 'line' shows fewer than 2 places of the route (ask for another part of it)");
}

}  // namespace
}  // namespace citylearn::testing
