// SPDX-License-Identifier: Apache-2.0
#include "env_service/imperfections.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/task/reward.h"
#include "core/task/spl.h"
#include "core/task/state_map.h"
#include "tests/support/env/env.h"
#include "tests/support/env/scripted_policy.h"

namespace citylearn::testing {
namespace {

struct Step {
  std::uint8_t action;
  msg::Observation before, after;
  std::optional<Environment::Episode> episode;  ///< that it ended
};

/// The steps of one agent that knows where it stands.
std::vector<Step> walk(const Imperfections& imperfections, const msg::TaskSettings& with, int steps) {
  const Traversal traversal = small_traversal(60);
  Environment environment(traversal, 1, imperfections);
  environment.reset(with);
  std::vector<Step> walked;
  Step step;
  environment.observe(step.after);
  ShortestPath walker;
  while (std::ssize(walked) < steps && !environment.done()) {
    step.before = step.after;
    step.action = walker.act(step.before, 0);
    environment.step(std::span(&step.action, 1));
    environment.observe(step.after);
    step.episode.reset();
    if (!environment.finished().empty()) step.episode = environment.finished()[0];
    walked.push_back(step);
  }
  return walked;
}

int at(const msg::Observation& seen) { return static_cast<int>(seen.position()[0]); }
int goal_of(const msg::Observation& seen) { return static_cast<int>(seen.goal()[0]); }

TEST(ImperfectWorld, ASlippingActionIsDoneNeverOrTwice) {
  int done[3] = {}, known = 0, unknown = 0;
  bool strayed = false;
  for (const Step& step : walk({.slip = 0.2}, settings(msg::TRAIN, 60, 200), 6000)) {
    const int way = step.action == kNext ? 1 : -1, times = (at(step.after) - at(step.before)) * way;
    ASSERT_TRUE(times >= 0 && times <= 2) << times;
    ++done[times];
    strayed = strayed || times != 1;
    const int left = std::abs(goal_of(step.before) - at(step.after));
    EXPECT_EQ(step.episode.has_value(), left == 0) << "an agent that passes over its goal has not reached it";
    if (!step.episode) {
      EXPECT_EQ(step.after.previous_action()[0], step.action) << "it is not told";
      continue;
    }
    EXPECT_EQ(step.episode->path.empty(), strayed) << "its actions say where it went, or are left out";
    ++(strayed ? unknown : known);
    strayed = false;
    EXPECT_LE(spl_of(true, step.episode->shortest, step.episode->steps), 1);
  }
  EXPECT_NEAR(done[0], 600, 100);
  EXPECT_NEAR(done[2], 600, 100);
  EXPECT_GT(known, 10);
  EXPECT_GT(unknown, 100);
}

TEST(ImperfectWorld, AnActionDoneTwiceStaysOnTheRoute) {
  const StateMap route(4);
  EXPECT_EQ(route.after(2, kNext, 2), 3);
  EXPECT_EQ(route.after(1, kPrevious, 2), 0);
  EXPECT_EQ(route.after(0, kNext, 2), 2);
  EXPECT_EQ(route.after(0, kNext, 0), 0);
  EXPECT_EQ(route.after(1, kStay, 2), 1);
}

TEST(ImperfectWorld, ADroppedFrameShowsTheOneBefore) {
  int dropped = 0, steps = 0, dropped_at_end = 0, ends = 0;
  for (const Step& step : walk({.dropped_frames = 0.3}, settings(msg::TRAIN, 60, 200), 3000)) {
    EXPECT_EQ(step.after.features()[0], static_cast<float>(step.after.frame()[0]));
    EXPECT_EQ(std::abs(at(step.after) - at(step.before)), 1) << "it walks all the same";
    if (step.episode) {
      EXPECT_FALSE(step.episode->path.empty());
      ++ends;
    }
    ++steps;
    const bool again = step.after.frame() == step.before.frame();
    EXPECT_TRUE(again || step.after.frame() == step.after.position());
    dropped += again;
    dropped_at_end += again && step.episode;
  }
  EXPECT_NEAR(static_cast<double>(dropped) / steps, 0.3, 0.04);
  EXPECT_NEAR(static_cast<double>(dropped_at_end) / ends, 0.3, 0.15) << "the last frame of an episode too";
}

TEST(ImperfectWorld, KidnapsSoOftenAnEpisodeAndNeverToTheGoal) {
  msg::TaskSettings with = settings(msg::EVALUATE, 60, 500);
  with.tasks() = 300;
  int kidnappings = 0, late = 0, episodes = 0;
  for (const Step& step : walk({.kidnappings = 2}, with, 1000000)) {
    const int to = step.action == kNext ? at(step.before) + 1 : at(step.before) - 1;
    if (!step.episode) {
      EXPECT_NE(at(step.after), goal_of(step.before));
      kidnappings += at(step.after) != to;
      continue;
    }
    EXPECT_TRUE(step.episode->completed);
    EXPECT_EQ(step.episode->shortest, std::abs(step.episode->goal - step.episode->start)) << "from the start";
    EXPECT_TRUE(step.episode->path.empty() || kidnappings == 0);
    EXPECT_LE(kidnappings, 2);
    late += kidnappings < 2;  // it came beside the goal, and there first
    kidnappings = 0;
    ++episodes;
  }
  EXPECT_EQ(episodes, 300);
  EXPECT_LT(late, 40);
  EXPECT_GT(late, 0);
}

TEST(ImperfectWorld, AKidnappingIsNoStepAndHasNoReward) {
  std::optional<EpisodeReward> rule;
  for (const Step& step : walk({.kidnappings = 3}, settings(msg::TRAIN, 60, 100), 3000)) {
    const int goal = goal_of(step.before), to = at(step.before) + (step.action == kNext ? 1 : -1);
    if (!rule) rule = EpisodeReward(std::abs(goal - at(step.before)), 100);
    EXPECT_EQ(step.after.reward()[0], rule->step(std::abs(goal - to)));
    if (step.episode)
      rule.reset();
    else
      rule->displace(std::abs(goal - at(step.after)));
  }
}

TEST(ImperfectWorld, HasRandomNumbersOfItsOwn) {
  msg::TaskSettings with = settings(msg::EVALUATE, 60, 500);
  with.tasks() = 50;
  const auto tasks = [&](const Imperfections& imperfections) {
    std::vector<std::pair<int, int>> drawn;
    for (const Step& step : walk(imperfections, with, 1000000))
      if (step.episode) drawn.emplace_back(step.episode->start, step.episode->goal);
    return drawn;
  };
  EXPECT_EQ(tasks({}), tasks({.slip = 0.3, .dropped_frames = 0.3, .kidnappings = 1})) << "the same tasks";
  const auto slipping = walk({.slip = 0.3}, with, 1000), both = walk({.slip = 0.3, .dropped_frames = 0.3}, with, 1000);
  ASSERT_EQ(slipping.size(), both.size());
  for (std::size_t i = 0; i < both.size(); ++i)
    ASSERT_EQ(slipping[i].after.position(), both[i].after.position()) << "the same slips, whatever is dropped";
}

TEST(ImperfectRecording, IsNamedAfterItsImperfections) {
  const Traversal plain = imperfect(small_traversal(9), {});
  EXPECT_EQ(plain.name, "line");
  EXPECT_EQ(plain.hash(), small_traversal(9).hash());
  const Imperfections agents = {.slip = 0.1, .dropped_frames = 0.05, .kidnappings = 1};
  EXPECT_EQ(imperfect(small_traversal(9), agents).name, "line-slip0.1-drop0.05-kidnap1");
  EXPECT_EQ(imperfect(small_traversal(9), agents).hash(), small_traversal(9).hash());
  for (const Imperfections& one :
       {agents, Imperfections{.slip = 1}, Imperfections{.dropped_frames = 1.5e-7}, Imperfections{.kidnappings = 20}})
    for (const std::string recording : {"a", "a-slip", "a-seed3"})
      EXPECT_EQ(world_of(name_in_world(recording, world_of(one))), world_of(one)) << recording;
  EXPECT_EQ(world_of("a-slip0.2-slip0.1-drop0.1"), "slip0.1-drop0.1") << "one recorded of a world that slips";
  for (const char* own :
       {"summer", "old-town", "slippery-slip", "a-seed3", "a-slip2", "a-slip0.1-", "a-slip.1", "-", ""})
    EXPECT_EQ(world_of(own), "") << own;
  Traversal long_name = small_traversal(9);
  long_name.name = std::string(63, 'x') + "/";
  EXPECT_EQ(imperfect(long_name, {.slip = 0.1}).name, std::string(56, 'x') + "-slip0.1");
}

}  // namespace
}  // namespace citylearn::testing
