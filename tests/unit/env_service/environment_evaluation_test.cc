// SPDX-License-Identifier: Apache-2.0
// Whole evaluations: the same tasks for every policy, shuffled frames, seeds, and the figures of known policies.
#include <gtest/gtest.h>

#include <map>
#include <numeric>
#include <set>

#include "env_service/environment.h"
#include "tests/support/env/env.h"
#include "tests/support/env/walkers.h"

namespace citylearn::testing {
namespace {

TEST(EnvironmentEvaluate, SameTasksWhoeverActsAndHoweverManyAgents) {
  const Traversal traversal = small_traversal(128);
  const msg::TaskSettings with = evaluation(53);
  BlindSweep blind(128);
  ShortestPath shortest;
  Environment one(traversal, 1), many(traversal, 16), more(traversal, 100);
  many.allow_evaluation_agents(30);
  const auto alone = evaluate(one, with, blind), together = evaluate(many, with, blind);
  const auto spare = evaluate(more, with, blind), quick = evaluate(many, with, shortest);
  ASSERT_EQ(alone.size(), 53u);
  for (const auto& [task, episode] : alone) {
    for (const auto* other : {&together, &spare, &quick}) {
      ASSERT_TRUE(other->contains(task));
      EXPECT_EQ(other->at(task).start, episode.start);
      EXPECT_EQ(other->at(task).goal, episode.goal);
    }
    EXPECT_EQ(together.at(task).steps, episode.steps);
    EXPECT_EQ(together.at(task).reward, episode.reward);
    EXPECT_EQ(quick.at(task).steps, episode.shortest);
    EXPECT_EQ(quick.at(task).reward, 1.0f);
  }
}

TEST(EnvironmentEvaluate, HasAnAgentForEachTaskWhereItMay) {
  Traversal wide = small_traversal(64);
  wide.dimension = 300;  // 60,000 bytes are the features of 50 agents
  wide.features.resize(64 * 300);
  Environment environment(wide, 4);
  environment.allow_evaluation_agents(100);
  const auto agents = [&](msg::Mode mode, std::uint32_t tasks, bool by_reference = true) {
    msg::TaskSettings with = settings(mode, 64, 64);
    with.tasks() = tasks;
    with.by_reference() = by_reference;
    environment.reset(with);
    msg::Observation seen;
    environment.observe(seen);
    return seen.goal().size();
  };
  EXPECT_EQ(agents(msg::EVALUATE, 500), 100u);
  EXPECT_EQ(agents(msg::EVALUATE, 500, false), 50u);
  EXPECT_EQ(agents(msg::EVALUATE, 60), 60u);
  EXPECT_EQ(agents(msg::EVALUATE, 1), 4u);
  EXPECT_EQ(agents(msg::TRAIN, 0), 4u);
}

TEST(EnvironmentEvaluate, DoesTheTasksOfARange) {
  const Traversal traversal = small_traversal(64);
  BlindSweep blind(64);
  Environment environment(traversal, 4);
  msg::TaskSettings with = evaluation(20, 64);
  const auto whole = evaluate(environment, with, blind);
  with.first_task() = 13;
  with.tasks() = 5;
  const auto range = evaluate(environment, with, blind);
  ASSERT_EQ(range.size(), 5u);
  EXPECT_EQ(range.begin()->first, 13);
  for (const auto& [task, episode] : range) {
    EXPECT_EQ(episode.start, whole.at(task).start);
    EXPECT_EQ(episode.goal, whole.at(task).goal);
    EXPECT_EQ(episode.path, whole.at(task).path);
  }
}

TEST(EnvironmentEvaluate, AgentsWithoutTasksAreIdleAndTheirActionsIgnored) {
  const Traversal traversal = small_traversal(16);
  for (const bool shuffle : {false, true}) {
    Environment environment(traversal, 3);
    msg::TaskSettings with = settings(msg::EVALUATE, 16, 2);
    with.tasks() = 1;
    with.shuffle() = shuffle;
    environment.reset(with);
    msg::Observation seen;
    environment.observe(seen);
    EXPECT_EQ(seen.flags()[0], msg::FLAG_FIRST);
    EXPECT_EQ(seen.flags()[1], msg::FLAG_IDLE);
    EXPECT_EQ(seen.flags()[2], msg::FLAG_IDLE);
    EXPECT_FALSE(environment.done());
    const std::vector<std::uint8_t> choice{kStay, 255, 77};
    environment.step(choice);
    EXPECT_FALSE(environment.done());
    environment.step(choice);
    EXPECT_TRUE(environment.done());
    environment.observe(seen);
    EXPECT_EQ(seen.flags()[0], msg::FLAG_TRUNCATED | msg::FLAG_IDLE) << "the end of its last episode is told";
    EXPECT_EQ(seen.reward()[0], -0.5f);
    EXPECT_EQ(environment.finished().size(), 1u);
    environment.step(choice);
    environment.observe(seen);
    EXPECT_EQ(seen.flags()[0], msg::FLAG_IDLE);
    EXPECT_EQ(seen.reward()[0], 0);
    EXPECT_TRUE(environment.finished().empty());
  }
}

TEST(EnvironmentShuffle, ShowsAnotherOrderInEachEpisodeAndTheSameInOneTask) {
  const Traversal traversal = small_traversal(40);
  const auto orders = [&](int agents) {
    msg::TaskSettings with = settings(msg::EVALUATE, 32, 64);
    with.first_frame() = 8;
    with.shuffle() = true;
    with.tasks() = 6;
    Environment environment(traversal, agents);
    environment.reset(with);
    msg::Observation seen;
    std::map<int, std::map<std::uint32_t, std::uint32_t>> shown;  // by task: frame shown at each position
    std::vector<int> task(agents);
    std::iota(task.begin(), task.end(), 0);
    BlindSweep walker(40);
    std::vector<std::uint8_t> choice(agents);
    while (!environment.done()) {
      environment.observe(seen);
      for (int agent = 0; agent < agents; ++agent) {
        choice[agent] = kStay;
        if (seen.flags()[agent] & msg::FLAG_IDLE) continue;
        auto& places = shown[task[agent]];
        const auto [place, fresh] = places.emplace(seen.position()[agent], seen.frame()[agent]);
        EXPECT_EQ(place->second, seen.frame()[agent]) << "one order throughout an episode";
        EXPECT_EQ(seen.features()[agent * 2], static_cast<float>(seen.frame()[agent]))
            << "features are the shown frame's";
        EXPECT_TRUE(seen.frame()[agent] >= 8 && seen.frame()[agent] < 40);
        choice[agent] = walker.act(seen, agent);
      }
      environment.step(choice);
      for (const auto& episode : environment.finished()) task[episode.agent] += agents;
    }
    return shown;
  };
  const auto one = orders(1), four = orders(4);
  EXPECT_EQ(one, four) << "the order depends on the task, not on the agent";
  std::set<std::uint32_t> frames;
  for (const auto& [position, frame] : one.at(0)) frames.insert(frame);
  EXPECT_EQ(frames.size(), one.at(0).size()) << "each frame at one place";
  EXPECT_NE(one.at(0), one.at(1));
}

TEST(EnvironmentDeterminism, ResetForgetsEverything) {
  const Traversal traversal = small_traversal(64);
  Environment used(traversal, 4), fresh(traversal, 4);
  msg::TaskSettings with = settings(msg::EVALUATE, 64, 32);
  with.shuffle() = true;
  BlindSweep walker(64);
  used.reset(settings(msg::TRAIN, 10, 5, 99));
  for (int i = 0; i < 7; ++i) used.step(std::vector<std::uint8_t>(4, kStay));
  const auto a = evaluate(used, with, walker), b = evaluate(fresh, with, walker);
  ASSERT_EQ(a.size(), b.size());
  for (const auto& [task, episode] : a) {
    EXPECT_EQ(episode.start, b.at(task).start);
    EXPECT_EQ(episode.steps, b.at(task).steps);
    EXPECT_EQ(episode.reward, b.at(task).reward);
  }
}

// TASK: an agent that never looks completes every task, in 53.2 steps, with reward .920 and SPL .852, on 128 frames.
TEST(EnvironmentFigures, BlindSweepAndShortestPath) {
  const Traversal traversal = small_traversal(128);
  Environment environment(traversal, 16);
  BlindSweep blind(128);
  ShortestPath shortest;
  const Figures swept = walk(environment, evaluation(20000), blind);
  EXPECT_EQ(swept.completed, 1);
  EXPECT_NEAR(swept.steps, 53.2, 0.6);
  EXPECT_NEAR(swept.reward, 0.920, 0.003);
  EXPECT_NEAR(swept.spl, 0.852, 0.005);
  EXPECT_NEAR(swept.excess, 2.6, 0.2);
  const Figures best = walk(environment, evaluation(20000), shortest);
  EXPECT_EQ(best.completed, 1);
  EXPECT_NEAR(best.steps, 43.0, 0.6);
  EXPECT_NEAR(best.reward, 1, 1e-6);
  EXPECT_EQ(best.spl, 1);
}

}  // namespace
}  // namespace citylearn::testing
