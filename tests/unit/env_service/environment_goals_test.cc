// SPDX-License-Identifier: Apache-2.0
// Tasks of several goals, reached one after the other.
#include <gtest/gtest.h>

#include <set>

#include "core/task/goal_chain.h"
#include "core/task/path.h"
#include "env_service/environment.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::uint8_t towards(const msg::Observation& seen, std::size_t agent = 0) {
  return seen.position()[agent] < seen.goal()[agent] ? kNext : kPrevious;
}

TEST(EnvironmentGoals, EachIsRewardedAndTheLastEndsTheEpisode) {
  const Traversal traversal = small_traversal(20);
  Environment environment(traversal, 1, {}, 3);
  environment.reset(settings(msg::TRAIN, 20, 100));
  msg::Observation seen;
  environment.observe(seen);
  EXPECT_EQ(seen.flags()[0], msg::FLAG_FIRST + 2 * kLaterGoal);
  const int start = static_cast<int>(seen.position()[0]);
  std::vector<int> goals{static_cast<int>(seen.goal()[0])};
  float reward = 0;
  int steps = 0;
  while (environment.finished().empty()) {
    const std::uint8_t action = towards(seen);
    environment.step(std::span(&action, 1));
    environment.observe(seen);
    ++steps;
    reward += seen.reward()[0];
    const bool there = static_cast<int>(seen.position()[0]) == goals.back();
    EXPECT_EQ(seen.reward()[0], there ? 1 : 0) << "each step leads nearer";
    if (!there || !environment.finished().empty()) continue;
    EXPECT_NE(static_cast<int>(seen.goal()[0]), goals.back()) << "the next one, at this tick";
    goals.push_back(static_cast<int>(seen.goal()[0]));
    EXPECT_EQ(seen.flags()[0], (3 - goals.size()) * kLaterGoal);
  }
  ASSERT_EQ(goals.size(), 3u);
  EXPECT_EQ(seen.flags()[0] % kLaterGoal, msg::FLAG_TERMINATED | msg::FLAG_FIRST);
  const Environment::Episode& episode = environment.finished()[0];
  EXPECT_TRUE(episode.completed);
  EXPECT_EQ(episode.start, start);
  EXPECT_EQ(episode.goal, goals[2]);
  EXPECT_EQ(episode.steps, steps);
  EXPECT_EQ(episode.shortest,
            std::abs(goals[0] - start) + std::abs(goals[1] - goals[0]) + std::abs(goals[2] - goals[1]));
  EXPECT_EQ(episode.reward, reward);
  EXPECT_EQ(reward, 3);
  EXPECT_EQ(episode.path.size(), path_octets(static_cast<std::uint64_t>(steps)));
}

TEST(EnvironmentGoals, TheLimitHoldsForAllOfThem) {
  const Traversal traversal = small_traversal(20);
  Environment environment(traversal, 1, {}, 2);
  environment.reset(settings(msg::EVALUATE, 20, 30));
  msg::Observation seen;
  const std::uint8_t stay = kStay;
  for (int step = 1; step < 60; ++step) {
    environment.step(std::span(&stay, 1));
    ASSERT_TRUE(environment.finished().empty()) << step;
  }
  environment.observe(seen);
  EXPECT_FLOAT_EQ(seen.reward()[0], -1 / 60.0f);
  const int goal = static_cast<int>(seen.goal()[0]);
  environment.step(std::span(&stay, 1));
  ASSERT_EQ(environment.finished().size(), 1u) << "2 goals x 30 steps";
  EXPECT_FALSE(environment.finished()[0].completed);
  EXPECT_NE(environment.finished()[0].goal, goal) << "the last goal, to which it never went";
  environment.observe(seen);
  EXPECT_TRUE(seen.flags()[0] & msg::FLAG_TRUNCATED);
}

/// The tasks of an evaluation: start, last goal and fewest steps by number.
std::map<int, std::array<int, 3>> tasks_of(const Traversal& traversal, std::uint64_t walk) {
  Environment environment(traversal, 3, {}, 4);
  msg::TaskSettings with = settings(msg::EVALUATE, static_cast<std::uint32_t>(traversal.frames), 40);
  with.tasks() = 30;
  environment.reset(with);
  Random random{walk};
  std::map<int, std::array<int, 3>> tasks;
  std::vector<std::uint8_t> choice(3);
  for (msg::Observation seen; !environment.done(); environment.step(choice)) {
    environment.observe(seen);
    for (std::size_t agent = 0; agent < 3; ++agent) do
        choice[agent] = static_cast<std::uint8_t>(random.below(kActions));
      while (!(seen.allowed()[agent] >> choice[agent] & 1));
    for (const Environment::Episode& episode : environment.finished())
      tasks[episode.task] = {episode.start, episode.goal, episode.shortest};
  }
  return tasks;
}

TEST(EnvironmentGoals, TasksAreThoseOfTheirNumbersForEveryPolicy) {
  for (const Traversal& traversal : {small_traversal(13), streets_traversal()}) {
    const auto tasks = tasks_of(traversal, 1);
    EXPECT_GE(tasks.size(), 27u);
    for (const auto& [task, what] : tasks_of(traversal, 2)) {
      if (!tasks.contains(task)) continue;
      EXPECT_EQ(tasks.at(task), what) << task;
    }
  }
}

TEST(EnvironmentGoals, AreWhereOneCanGoOnAndNotThereYet) {
  // 7 places of which only 0, 4 and 6 are shown.
  Traversal line = small_traversal(7);
  line.unmatched = {false, true, true, true, false, true, false};
  std::set<std::uint32_t> goals;
  Environment environment(line, 1, {}, 5);
  environment.reset(settings(msg::TRAIN, 7, 100));
  msg::Observation seen;
  for (int step = 0; step < 300; ++step) {
    environment.observe(seen);
    goals.insert(seen.goal()[0]);
    const std::uint8_t action = towards(seen);
    environment.step(std::span(&action, 1));
  }
  EXPECT_EQ(goals, (std::set<std::uint32_t>{0, 4, 6}));
  const Traversal streets = streets_traversal();
  Environment wide(streets, 1, {}, 2);
  msg::TaskSettings with = settings(msg::TRAIN, 13, 100);
  with.goal_radius() = 1000;
  EXPECT_TRUE(contains(error_of([&] { wide.reset(with); }), "finds no goal that can be reached"));
}

TEST(EnvironmentGoals, NobodyIsCarriedAwayOnArrival) {
  Imperfections imperfections;
  imperfections.kidnappings = 5;
  const Traversal traversal = small_traversal(40);
  Environment environment(traversal, 4, imperfections, 4);
  environment.reset(settings(msg::TRAIN, 40, 400));
  msg::Observation seen, before;
  std::vector<std::uint8_t> choice(4);
  int arrived = 0;
  for (int step = 0; step < 2000; ++step) {
    environment.observe(seen);
    for (std::size_t agent = 0; agent < 4; ++agent) {
      if (step > 0 && !(seen.flags()[agent] & msg::FLAG_FIRST) && seen.goal()[agent] != before.goal()[agent]) {
        EXPECT_EQ(seen.position()[agent], before.goal()[agent]);
        ++arrived;
      }
      choice[agent] = towards(seen, agent);
    }
    before = seen;
    environment.step(choice);
  }
  EXPECT_GT(arrived, 100);
}

}  // namespace
}  // namespace citylearn::testing
