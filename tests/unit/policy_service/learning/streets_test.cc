// SPDX-License-Identifier: Apache-2.0
// Learning on streets.
#include <gtest/gtest.h>

#include "core/task/spl.h"
#include "policy_service/learning/learners/relabel.h"
#include "policy_service/rollout/network_policy.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// On small_states(), from place 1 to the west: to 0, round, over 1 to 2, to the dead end 4 and back, over 3 to 6.
Rollout street_walk() {
  const std::vector<int> states = {3, 1, 0, 2, 5, 4, 8, 5, 7, 12};
  Rollout rollout;
  rollout.resize(1, 1, 9, 1, 9);
  rollout.action = {kForward, kRight, kForward, kForward, kLeft, kForward, kForward, kForward, kForward};
  rollout.max_steps = 100;
  rollout.step_cost = 0.25f;
  for (std::size_t t = 0; t <= 9; ++t) {
    NetworkInputs<float>& inputs = t < 9 ? rollout.inputs : rollout.next;
    inputs.frames = 13;
    const std::size_t i = t % 9;
    inputs.see(static_cast<std::ptrdiff_t>(i), -1, Vector<float>::Constant(1, static_cast<float>(t)));
    inputs.position[i] = states[t];
    inputs.goal[i] = 5;
    inputs.allowed[i] = small_states()->allowed(states[t]);
    inputs.first[i] = 0;
  }
  return rollout;
}

/// Lives the walk again with `goal` for its first episode. Returns its rewards up to the end of that episode.
std::vector<float> rewards_to(int goal, int max_detour, Rollout::Ended& ended) {
  Rollout rollout = street_walk();
  rollout.max_detour = max_detour;
  Rollout* const rollouts[] = {&rollout};
  Replay replay(100);
  replay.add(rollouts);
  RelabelMap map{small_states()};
  GradientStep::Shard shard;
  TrajectoryBatch<float> trajectories;
  std::vector<float> rewards;
  std::uint64_t seed = 0;
  do {
    shard.inputs.resize(1, 10, 1);
    shard.state.setOnes(1, 1);
    trajectories.resize(10);
    Random random{seed};
    relabel(replay, 0, 1, rollout, map, random, 0, shard, trajectories);
  } while (shard.inputs.goal[0] != goal && ++seed < 1000);
  std::size_t row = 0;
  for (; row < 9 && trajectories.action[row] != kNoAction; ++row) {
    rewards.push_back(trajectories.reward[row]);
    if (trajectories.ended[row] != Rollout::kGoesOn) break;
  }
  ended = static_cast<Rollout::Ended>(trajectories.ended[rewards.size() - 1]);
  EXPECT_TRUE(shard.inputs.first[row + 1]);
  return rewards;
}

TEST(RelabelOnStreets, RewardsAreThoseOfTheFewestSteps) {
  Rollout::Ended ended;
  // Fewest steps to place 3 on the way: 3, 3, 3, 2, 1, 2, 2, 1, 0; to place 4: 4, 5, 4, 3, 2, 1, 0.
  EXPECT_EQ(rewards_to(3, 0, ended), (std::vector<float>{-0.25f, -0.25f, 0, 0, -0.25f, -0.25f, -0.25f, 1}));
  EXPECT_EQ(ended, Rollout::kTerminated);
  EXPECT_EQ(rewards_to(4, 0, ended), (std::vector<float>{-0.25f, -0.25f, 0, 0, 0, 1}));
  EXPECT_EQ(ended, Rollout::kTerminated);
  // No more than twice 3 steps: the episode breaks off.
  EXPECT_EQ(rewards_to(3, 2, ended), (std::vector<float>{-0.25f, -0.25f, 0, 0, -0.25f, -0.25f}));
  EXPECT_EQ(ended, Rollout::kGoesOn);
}

TEST(RelabelOnStreets, GoalsCanBeReached) {
  // Places 0 and 1 lead to 2 and 3, from which nothing leads back.
  StreetMap streets{{0, 0, 10, 20}, {0, 10, 10, 10}, {0, 1, 1, 2, 3}, {1, 2, 0, 3, 2}, {0, 90, 180, 90, 270}};
  RelabelMap map{std::make_shared<const StateMap>(streets, StateRule::kStreet, 100)};
  Rollout rollout;
  rollout.resize(1, 1, 2, 1, 2);
  rollout.max_steps = 10;
  rollout.inputs.frames = rollout.next.frames = 5;
  for (NetworkInputs<float>* inputs : {&rollout.inputs, &rollout.next})
    for (std::size_t i = 0; i < inputs->goal.size(); ++i) {
      inputs->see(static_cast<std::ptrdiff_t>(i), -1, Vector<float>::Zero(1));
      inputs->position[i] = 3;  // place 2
    }
  Rollout* const rollouts[] = {&rollout};
  Replay replay(10);
  replay.add(rollouts);
  for (std::uint64_t seed = 0; seed < 50; ++seed) {
    Random random{seed};
    EXPECT_EQ(choose_goal(replay, 0, 0, 0.5, map, random), 3);
  }
  EXPECT_FALSE(was_carried(*map.states, 0, kForward, 1));
  EXPECT_FALSE(was_carried(*map.states, 0, kForward, 3)) << "two steps";
  EXPECT_TRUE(was_carried(*map.states, 0, kForward, 2));
}

/// A grid of so many places a side, 10 m apart, linked both ways.
StreetMap street_grid(int side) {
  StreetMap map;
  for (int place = 0; place < side * side; ++place) {
    const int row = place / side, column = place % side;
    map.east.push_back(10.0f * static_cast<float>(column));
    map.north.push_back(10.0f * static_cast<float>(row));
    const auto link = [&](bool there, int to, float heading) {
      if (!there) return;
      map.from.push_back(static_cast<std::uint32_t>(place));
      map.to.push_back(static_cast<std::uint32_t>(to));
      map.heading.push_back(heading);
    };
    link(row + 1 < side, place + side, 0);
    link(column + 1 < side, place + 1, 90);
    link(row > 0, place - side, 180);
    link(column > 0, place - 1, 270);
  }
  map.check();
  return map;
}

/// Returns how many tasks on a city an agent completed, and its mean SPL.
std::pair<int, double> walk_all(const TrainedAgent& agent, const Traversal& city, std::uint32_t tasks) {
  Environment environment(city, 4);
  msg::TaskSettings with = settings(msg::EVALUATE, city.frames, city.frames, 7);
  with.tasks() = tasks;
  with.max_detour() = 3;
  environment.reset(with);
  NetworkPolicy policy(agent, {});
  policy.begin(0, {});
  msg::Observation seen;
  std::vector<std::uint8_t> choice;
  int completed = 0;
  double spl = 0;
  while (!environment.done()) {
    environment.observe(seen);
    policy.act(seen, choice);
    environment.step(choice);
    for (const Environment::Episode& episode : environment.finished()) {
      completed += episode.completed;
      spl += spl_of(episode.completed, episode.shortest, episode.steps) / static_cast<double>(tasks);
    }
  }
  return {completed, spl};
}

TrainerOptions street_options(const std::string& learner) {
  TrainerOptions options = small_options("place_filter");
  options.learner = learner;
  options.max_detour = 3;
  return options;
}

TEST(Streets, AnAgentThatHasLearnedNothingWalksToItsGoal) {
  for (const StateRule rule : {StateRule::kStreet, StateRule::kStreetFixed}) {
    const Traversal city = streets_traversal(street_grid(4), rule);
    const Loop loop(city, street_options("relabel"));
    const auto [completed, spl] = walk_all(loop.trainer.agent(), city, 40);
    EXPECT_EQ(completed, 40);
    EXPECT_GT(spl, 0.9);
  }
}

TEST(Streets, WhatIsLearnedWalksAnotherCity) {
  const Traversal city = streets_traversal(), other = streets_traversal(street_grid(4));
  Loop loop(city, street_options("relabel"));
  for (int i = 0; i < 3; ++i) loop.update();
  const Checkpoint checkpoint = loop.trainer.checkpoint();
  EXPECT_TRUE(contains(error_of([&] { trained_agent(checkpoint); }), "walks by the map of its streets"));
  TrainedAgent agent = unbuilt_agent(checkpoint);
  EXPECT_EQ(agent.places, 7);
  agent.build_network(task_of(other));
  EXPECT_EQ(walk_all(agent, other, 40).first, 40);
}

TEST(Streets, TrainingsAreReproducibleAndGoOn) {
  const Traversal city = streets_traversal();
  for (const char* learner : {"ppo", "relabel"}) {
    TrainerOptions options = street_options(learner);
    options.trainer_parameters["noise-place"] = 1;
    expect_reproducible(city, options, 2, 3);
    expect_resumable(city, options, 3, 3);
  }
  TrainerOptions options = street_options("relabel"), others = options;
  others.max_detour = 4;
  Loop one(city, options), two(city, others);
  EXPECT_TRUE(
      contains(error_of([&] { two.trainer.load(one.trainer.checkpoint()); }), "task.max_detour was 3, now it is 4"));
}

TEST(Streets, OtherNetworksLearnThereToo) {
  const Traversal city = streets_traversal();
  for (const char* network : {"baseline", "features"}) {
    TrainerOptions options = small_options(network);
    options.learner = "relabel";
    Loop loop(city, options);
    for (int i = 0; i < 2; ++i) loop.update();
    EXPECT_TRUE(loop.trainer.agent().parameters.allFinite());
  }
}

TEST(Streets, AreLearnedAsAWhole) {
  const Traversal city = streets_traversal();
  TrainerOptions options = street_options("ppo");
  options.curriculum = true;
  EXPECT_TRUE(contains(error_of([&] { Trainer(options, task_of(city)); }), "streets are learned as a whole"));
  NetworkTask fewer = task_of(city);
  fewer.frames = 5;
  EXPECT_TRUE(contains(error_of([&] { Trainer(street_options("ppo"), fewer); }), "streets are learned as a whole"));
}

}  // namespace
}  // namespace citylearn::testing
