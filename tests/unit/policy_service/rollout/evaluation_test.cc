// SPDX-License-Identifier: Apache-2.0
// An evaluation's results are the same however its tasks are divided among env_services and agents.
#include <gtest/gtest.h>

#include <functional>
#include <map>
#include <memory>
#include <utility>
#include <vector>

#include "env_service/environment.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/evaluated_tasks.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/rollout/task_waves.h"
#include "tests/support/env/env.h"
#include "tests/support/networks/small_networks.h"

namespace citylearn::testing {
namespace {

TEST(TaskWaves, HaveEachTaskOnceAndDouble) {
  for (const std::uint32_t tasks : {1u, 2u, 3u, 16u, 100u}) {
    std::uint32_t next = 0;
    SeenFeatures seen;
    seen.see(Vector<float>::Ones(2));
    for (TaskWaves waves(tasks); !waves.done(); waves.next({{waves.wave().first, seen}})) {
      EXPECT_EQ(waves.wave().first, next);
      EXPECT_LE(waves.wave().count, std::max(1u, next));
      EXPECT_EQ(waves.known().count > 0, next > 0) << "each knows what was seen before";
      next += waves.wave().count;
    }
    EXPECT_EQ(next, tasks);
  }
  EXPECT_TRUE(TaskWaves(0).done());
}

TEST(TaskWaves, AreTwoOfAPolicyThatLearnsNothingFromWhatItSees) {
  TaskWaves waves(100);
  waves.next({});
  EXPECT_EQ(waves.wave().first, 1u);
  EXPECT_EQ(waves.wave().count, 99u);
  waves.next({});
  EXPECT_TRUE(waves.done());
}

TEST(EvaluatedTasks, KeepEachTaskInItsColumn) {
  EvaluatedTasks tasks;
  tasks.begin(40, {});
  msg::Observation seen;
  seen.flags().assign(20, msg::FLAG_FIRST);
  seen.flags()[3] = msg::FLAG_IDLE;
  tasks.follow(seen);
  ASSERT_EQ(tasks.batches().size(), 2u);
  EXPECT_EQ(tasks.batches()[0][40 % 16], 0);
  EXPECT_EQ(tasks.batches()[1][40 % 16], 16);
  EXPECT_EQ(tasks.batches()[0][43 % 16], 19) << "in the first batch with room";
  seen.flags().assign(20, 0);
  seen.flags()[3] = msg::FLAG_IDLE;
  seen.flags()[2] = msg::FLAG_FIRST | msg::FLAG_TERMINATED;
  tasks.follow(seen);
  EXPECT_EQ(tasks.task(2), 62u);
  EXPECT_EQ(tasks.task(1), 41u);
  EXPECT_EQ(tasks.batches()[0][62 % 16], 2);
  seen.flags().assign(20, msg::FLAG_IDLE);
  tasks.follow(seen);
  EXPECT_TRUE(tasks.batches().empty());
}

TEST(EvaluatedTasks, KnowWhatWasSeenInEarlierOnesWhereNobodyNumbersThem) {
  for (const bool numbered : {false, true}) {
    EvaluatedTasks tasks;
    if (numbered) tasks.begin(0, {});
    msg::Observation seen;
    const auto see = [&](int agent, float one, float other) {
      Vector<float> features = Eigen::Vector2f(one, other);
      tasks.normalise(FeatureNormaliser(), agent, features);
      return tasks.total().numbers();
    };
    seen.flags().assign(2, msg::FLAG_FIRST);
    tasks.follow(seen);
    EXPECT_EQ(see(0, 1, 0), Eigen::Vector3f(1, 0, 1));
    EXPECT_EQ(see(1, 0, 4), Eigen::Vector3f(0, 4, 1)) << "not what others see in a task that goes on";
    seen.flags()[1] = 0;
    tasks.follow(seen);
    EXPECT_EQ(see(1, 0, 4), numbered ? Eigen::Vector3f(0, 8, 2) : Eigen::Vector3f(1, 8, 3));
    EXPECT_EQ(see(0, 2, 0), numbered ? Eigen::Vector3f(2, 0, 1) : Eigen::Vector3f(3, 0, 2));
    EXPECT_EQ(tasks.seen().size(), numbered ? 3u : 2u) << "what is known is kept once";
  }
}

constexpr int kTasks = 60;

struct Walk {
  int start, goal, steps;
  std::vector<std::uint8_t> path;
  bool operator==(const Walk&) const = default;
};

/// Evaluates as a run does, each wave cut into pieces at random, for env_services with so many agents.
std::map<int, Walk> evaluated(const std::function<std::unique_ptr<Policy>()>& make, const Traversal& city,
                              const std::vector<int>& agents, SeenFeatures& known) {
  std::map<int, Walk> walks;
  const auto frames = static_cast<std::uint32_t>(city.frames);
  msg::TaskSettings part = settings(msg::EVALUATE, frames, frames, 9);
  std::vector<std::pair<Environment, std::unique_ptr<Policy>>> services;
  for (const int count : agents) services.emplace_back(Environment(city, count), make());
  Random random{agents.size()};
  msg::Observation seen;
  std::vector<std::uint8_t> choice;
  TaskWaves waves(kTasks);
  while (!waves.done()) {
    std::map<std::uint32_t, SeenFeatures> seen_in;
    for (TaskRange rest = waves.wave(); rest.count > 0;) {
      const auto count = services.size() == 1 ? rest.count : static_cast<std::uint32_t>(1 + random.below(rest.count));
      rest.count -= count;  // from the end
      part.first_task() = rest.first + rest.count;
      part.tasks() = count;
      auto& [environment, policy] = services[random.below(services.size())];
      environment.reset(part);
      policy->begin(part.first_task(), waves.known());
      while (!environment.done()) {
        environment.observe(seen);
        policy->act(seen, choice);
        environment.step(choice);
        for (const auto& e : environment.finished()) walks[e.task] = {e.start, e.goal, e.steps, e.path};
      }
      seen_in.merge(policy->seen());
    }
    waves.next(seen_in);
  }
  known = waves.known();
  return walks;
}

void expect_same_however_divided(const std::function<std::unique_ptr<Policy>()>& make, const Traversal& city) {
  SeenFeatures expected_seen;
  const auto expected = evaluated(make, city, {1}, expected_seen);
  ASSERT_EQ(expected.size(), std::size_t{kTasks});
  for (const std::vector<int>& agents : {std::vector<int>{7}, {50}, {64, 64, 64, 64}, {3, 20, 1}}) {
    SeenFeatures seen;
    const auto found = evaluated(make, city, agents, seen);
    EXPECT_TRUE(found == expected) << agents.size() << " env_services, the first of " << agents[0] << " agents";
    EXPECT_EQ(seen.count, expected_seen.count);
    EXPECT_EQ(seen.sum, expected_seen.sum);
  }
}

class EachEvaluated : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Networks, EachEvaluated,
                         ::testing::Values("baseline", "features", "place_filter", "raw_images"),
                         [](const auto& tested) { return tested.param; });

TEST_P(EachEvaluated, DoesATaskTheSameWhoeverActsBesideIt) {
  const Traversal city = small_city_for(GetParam());
  Loop loop(city, small_options(GetParam()), 1, 6);
  loop.update();
  const TrainedAgent agent = loop.trainer.agent();
  expect_same_however_divided([&] { return std::make_unique<NetworkPolicy>(agent, NetworkPolicy::Options{.seed = 5}); },
                              city);
}

TEST(Controls, DoATaskTheSameWhoeverActsBesideThem) {
  const Traversal city = small_city();
  for (const auto* entry : ControlRegistry::instance().entries()) {
    SCOPED_TRACE(entry->name);
    const ControlTask task{0, city.frames, task_of(city).reference};
    expect_same_however_divided([&] { return entry->create(Parameters(entry->name, entry->parameters, {}), task); },
                                city);
  }
}

}  // namespace
}  // namespace citylearn::testing
