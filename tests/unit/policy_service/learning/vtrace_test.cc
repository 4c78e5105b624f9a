// SPDX-License-Identifier: Apache-2.0
// V-trace's targets and loss, and episodes lived again with other goals.
#include <gtest/gtest.h>

#include <cmath>

#include "core/util/random.h"
#include "policy_service/learning/learners/relabel.h"
#include "policy_service/learning/optimization/vtrace_loss.h"
#include "tests/support/env/env.h"
#include "tests/support/networks/small_networks.h"

namespace citylearn {
namespace {

constexpr int kSteps = 9, kAgents = 3;  // the last step has no action

Heads<double> some_heads(Random& random) {
  Heads<double> heads;
  heads.logits.resize(kActions, kSteps * kAgents);
  heads.values.resize(1, kSteps * kAgents);
  for (double& value : heads.logits.reshaped()) value = random.normal();
  for (double& value : heads.values.reshaped()) value = random.normal();
  return heads;
}

double log_p(const Heads<double>& heads, std::ptrdiff_t column, int action) {
  return heads.logits(action, column) - std::log(heads.logits.col(column).array().exp().sum());
}

/// `far` is how far the policy that walked was from the heads'. With `ends` episodes end, are cut and break off.
TrajectoryBatch<double> some_trajectories(const Heads<double>& heads, double far, bool ends, Random& random) {
  TrajectoryBatch<double> trajectories;
  trajectories.resize(kSteps * kAgents);
  for (int t = 0; t < kSteps; ++t)
    for (int b = 0; b < kAgents; ++b) {
      const auto i = static_cast<std::size_t>(t * kAgents + b);
      const bool acts = t < kSteps - 1 && !(ends && t == 4 && b == 1);
      trajectories.action[i] = acts ? static_cast<std::uint8_t>(random.below(kActions)) : std::uint8_t{kNoAction};
      trajectories.ended[i] = !ends              ? Rollout::kGoesOn
                              : t == 3 && b == 0 ? Rollout::kTerminated
                              : t == 5 && b == 2 ? Rollout::kTruncated
                                                 : Rollout::kGoesOn;
      trajectories.reward[i] = random.normal();
      trajectories.final_value[i] = random.normal();
      trajectories.log_probability[i] =
          acts ? log_p(heads, static_cast<std::ptrdiff_t>(i), trajectories.action[i]) + far * random.normal() : 0;
    }
  return trajectories;
}

/// The definition, term by term: v_s = V(x_s) + sum over t >= s of gamma^(t-s) (c_s .. c_(t-1)) rho_t (r_t + gamma
/// V(x_(t+1)) - V(x_t)).
double target_by_definition(const VtraceLimits& limits, const Heads<double>& heads,
                            const TrajectoryBatch<double>& trajectories, int start, int agent) {
  double target = heads.values(0, start * kAgents + agent), weight = 1;
  for (int t = start; t < kSteps; ++t) {
    const auto i = static_cast<std::size_t>(t * kAgents + agent);
    if (trajectories.action[i] == kNoAction) break;
    const double ratio = std::exp(log_p(heads, static_cast<std::ptrdiff_t>(i), trajectories.action[i]) -
                                  trajectories.log_probability[i]);
    double next = heads.values(0, (t + 1) * kAgents + agent);
    if (trajectories.ended[i] == Rollout::kTerminated) next = 0;
    if (trajectories.ended[i] == Rollout::kTruncated) next = trajectories.final_value[i];
    target += weight * std::min(limits.rho, ratio) *
              (trajectories.reward[i] + limits.gamma * next - heads.values(0, static_cast<std::ptrdiff_t>(i)));
    if (trajectories.ended[i] != Rollout::kGoesOn) break;
    weight *= limits.gamma * limits.lambda * std::min(limits.c, ratio);
  }
  return target;
}

TEST(Vtrace, TargetsAreThoseOfThePaper) {
  Random random{1};
  const Heads<double> heads = some_heads(random);
  for (const VtraceLimits& limits : {VtraceLimits{0.9, 1, 1, 1}, VtraceLimits{0.97, 0.8, 1.5, 0.7}}) {
    TrajectoryBatch<double> trajectories = some_trajectories(heads, 1, true, random);
    vtrace(limits, heads, kAgents, trajectories);
    for (int t = 0; t < kSteps; ++t)
      for (int b = 0; b < kAgents; ++b) {
        const auto i = static_cast<std::size_t>(t * kAgents + b);
        EXPECT_NEAR(trajectories.target[i], target_by_definition(limits, heads, trajectories, t, b), 1e-12)
            << t << " " << b;
        if (trajectories.action[i] == kNoAction) {
          EXPECT_EQ(trajectories.weight[i], 0);
          continue;
        }
        const double ratio = std::exp(log_p(heads, static_cast<std::ptrdiff_t>(i), trajectories.action[i]) -
                                      trajectories.log_probability[i]);
        EXPECT_NEAR(trajectories.weight[i], std::min(limits.rho, ratio), 1e-12);
        if (limits.lambda < 1) continue;
        double next = target_by_definition(limits, heads, trajectories, t + 1, b);  // section 4.2
        if (trajectories.ended[i] == Rollout::kTerminated) next = 0;
        if (trajectories.ended[i] == Rollout::kTruncated) next = trajectories.final_value[i];
        EXPECT_NEAR(trajectories.advantage[i],
                    trajectories.reward[i] + limits.gamma * next - heads.values(0, static_cast<std::ptrdiff_t>(i)),
                    1e-12);
      }
  }
}

TEST(Vtrace, OnPolicyAdvantagesAreGeneralisedAdvantageEstimates) {
  Random random{3};
  const Heads<double> heads = some_heads(random);
  TrajectoryBatch<double> trajectories = some_trajectories(heads, 0, false, random);
  vtrace(VtraceLimits{0.9, 0.8, 1, 1}, heads, kAgents, trajectories);
  Rollout rollout;
  rollout.resize(0, 1, kSteps - 1, kAgents, kSteps - 1);
  for (std::size_t i = 0; i < rollout.reward.size(); ++i) {
    rollout.reward[i] = static_cast<float>(trajectories.reward[i]);
    rollout.value[i] = static_cast<float>(heads.values(0, static_cast<std::ptrdiff_t>(i)));
  }
  for (std::size_t b = 0; b < kAgents; ++b)
    rollout.last_value[b] = static_cast<float>(heads.values(0, static_cast<std::ptrdiff_t>(rollout.reward.size() + b)));
  rollout.estimate_advantages(0.9, 0.8);
  for (std::size_t i = 0; i < rollout.reward.size(); ++i)
    EXPECT_NEAR(trajectories.advantage[i], rollout.advantage[i], 1e-5);
}

TEST(Vtrace, LossAgreesWithCentralDifferences) {
  Random random{4};
  Heads<double> heads = some_heads(random);
  heads.auxiliary.resize(2, kSteps * kAgents);
  for (double& value : heads.auxiliary.reshaped()) value = random.normal();
  NetworkInputs<double> inputs;
  inputs.resize(0, kSteps, kAgents);
  for (std::size_t i = 0; i < inputs.goal.size(); ++i) {
    inputs.position[i] = static_cast<int>(random.below(7));
    inputs.goal[i] = static_cast<int>(random.below(7));
  }
  const VtraceLimits limits{0.9, 0.8, 1.2, 1};
  const LossWeights weights{0.5, 0.3, 0.7, 0.4};
  TrajectoryBatch<double> trajectories = some_trajectories(heads, 0.5, true, random);
  vtrace(limits, heads, kAgents, trajectories);  // constants from here on
  const double share = 0.1;
  Heads<double> derivative, unused;
  vtrace_loss(weights, limits, trajectories, inputs, 7, heads, 1.7, share, derivative);
  const auto check = [&](Matrix<double>& values, const Matrix<double>& found) {
    ASSERT_EQ(values.size(), found.size());
    double largest = 0;
    for (std::ptrdiff_t i = 0; i < values.size(); ++i) {
      const double numeric = central_difference(values.reshaped()(i), [&] {
        return vtrace_loss(weights, limits, trajectories, inputs, 7, heads, 1.7, share, unused).loss;
      });
      EXPECT_NEAR(found.reshaped()(i), share * numeric, 1e-8) << i;
      largest = std::max(largest, std::abs(found.reshaped()(i)));
    }
    EXPECT_GT(largest, 0.01);
  };
  check(heads.logits, derivative.logits);
  check(heads.values, derivative.values);
  check(heads.auxiliary, derivative.auxiliary);
}

/// A walk along 20 places that begins at place 5 and goes where `moves` say; its frames show the step's number.
Rollout walk_along(const std::vector<int>& moves, const std::vector<std::size_t>& ends) {
  Rollout rollout;
  const int length = static_cast<int>(moves.size());
  rollout.resize(1, 2, length, 1, length);
  rollout.max_steps = 6;
  int position = 5;
  for (int t = 0; t <= length; ++t) {
    NetworkInputs<float>& inputs = t < length ? rollout.inputs : rollout.next;
    inputs.frames = 20;
    const std::size_t i = t < length ? static_cast<std::size_t>(t) : 0;
    inputs.see(static_cast<std::ptrdiff_t>(i), -1, Vector<float>::Constant(1, static_cast<float>(t)));
    inputs.position[i] = position;
    inputs.allowed[i] = 0b111;
    inputs.goal[i] = 19;
    inputs.first[i] = 0;
    if (t == length) break;
    const int move = moves[i];
    position += move;
    rollout.action[i] = move > 0 ? kNext : move < 0 ? kPrevious : kStay;
    rollout.log_probability[i] = -0.1f * static_cast<float>(t);
  }
  for (const std::size_t end : ends) rollout.ended[end] = Rollout::kTruncated;
  return rollout;
}

RelabelMap line(int places) { return {std::make_shared<const StateMap>(places)}; }

TEST(Relabel, LivesAWalkAgainWithOtherGoals) {
  // Ends really after step 4; never comes back to where it was before.
  Rollout rollout = walk_along({1, 1, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1}, {4});
  rollout.step_cost = 0.25f;
  Rollout* const rollouts[] = {&rollout};
  Replay replay(100);
  replay.add(rollouts);
  RelabelMap map = line(20);
  GradientStep::Shard shard;
  TrajectoryBatch<float> trajectories;
  int terminated = 0, broken_off = 0, out_of_steps = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    shard.inputs.resize(1, 13, 1);
    shard.inputs.frames = 20;
    shard.state.setOnes(2, 1);
    trajectories.resize(13);
    Random random{seed};
    relabel(replay, 0, 0.5, rollout, map, random, 0, shard, trajectories);
    EXPECT_TRUE(shard.state.isZero());
    EXPECT_TRUE(shard.inputs.first[0]);
    EXPECT_EQ(trajectories.action[12], kNoAction);
    int steps = 0;
    EpisodeReward rule(0, 1);
    for (std::size_t row = 0; row < 13; ++row) {
      const auto t = static_cast<std::size_t>(shard.inputs.features_of(static_cast<std::ptrdiff_t>(row))(0));
      const int position = t < 12 ? rollout.inputs.position[t] : rollout.next.position[0];
      EXPECT_EQ(shard.inputs.position[row], position);
      if (shard.inputs.first[row]) {
        EXPECT_EQ(shard.inputs.previous_action[row], kNoAction);
        EXPECT_TRUE(row == 12 || shard.inputs.goal[row] != position);
        steps = 0;
        rule = {std::abs(shard.inputs.goal[row] - position), 6};
      } else {
        EXPECT_EQ(shard.inputs.previous_action[row], rollout.action[t - 1]);
        EXPECT_EQ(shard.inputs.goal[row], shard.inputs.goal[row - 1]);
      }
      if (row == 12) break;
      const auto next = static_cast<std::size_t>(shard.inputs.features_of(static_cast<std::ptrdiff_t>(row + 1))(0));
      if (trajectories.action[row] == kNoAction) {  // seen twice: what the one goes on with, the other's first
        EXPECT_EQ(next, t);
        EXPECT_TRUE(shard.inputs.first[row + 1]);
        EXPECT_FALSE(shard.inputs.first[row]);
        EXPECT_TRUE(t == 5 || steps == 6);
        ++(t == 5 ? broken_off : out_of_steps);
        continue;
      }
      ++steps;
      EXPECT_EQ(next, t + 1);
      EXPECT_EQ(trajectories.action[row], rollout.action[t]);
      EXPECT_EQ(trajectories.log_probability[row], rollout.log_probability[t]);
      const float reward = rule.step(std::abs(shard.inputs.goal[row] - shard.inputs.position[row + 1]));
      EXPECT_EQ(trajectories.reward[row], reward < 0 ? -0.25f : reward);
      EXPECT_EQ(trajectories.ended[row], rule.reached() ? Rollout::kTerminated : Rollout::kGoesOn);
      EXPECT_EQ(shard.inputs.position[row + 1] == shard.inputs.goal[row], rule.reached());
      EXPECT_EQ(shard.inputs.first[row + 1], rule.reached());
      terminated += rule.reached();
    }
  }
  EXPECT_GT(terminated, 50);
  EXPECT_GT(broken_off, 50);
  EXPECT_GT(out_of_steps, 20);
}

/// An agent that is carried to a place did not reach it, but what it reached before that counts.
TEST(Relabel, NobodyIsCarriedToAGoal) {
  Rollout rollout = walk_along({1, 1, 7, 1, 1, 1}, {});
  rollout.max_steps = 100;
  Rollout* const rollouts[] = {&rollout};
  Replay replay(100);
  replay.add(rollouts);
  RelabelMap map = line(20);
  GradientStep::Shard shard;
  TrajectoryBatch<float> trajectories;
  int reached_before = 0, carried_there = 0, carried_on = 0;
  for (std::uint64_t seed = 0; seed < 200; ++seed) {
    shard.inputs.resize(1, 7, 1);
    shard.state.setOnes(2, 1);
    trajectories.resize(7);
    Random random{seed};
    relabel(replay, 0, 0.5, rollout, map, random, 0, shard, trajectories);
    // The third step leads from place 7 to 8, from which the agent is carried to 14.
    if (shard.inputs.position[2] != 7 || shard.inputs.first[2]) continue;
    const int goal = shard.inputs.goal[2];
    EXPECT_EQ(shard.inputs.position[3], 14);
    EXPECT_EQ(trajectories.reward[2], goal == 8 ? 1.0f : goal > 8 ? 0.0f : -0.01f) << goal;
    EXPECT_EQ(trajectories.ended[2], goal == 8 ? Rollout::kTerminated : Rollout::kGoesOn);
    EXPECT_EQ(shard.inputs.first[3], goal == 8);
    if (goal == 8) {
      ++reached_before;
    } else if (goal == 14) {  // it cannot know: what it goes on with is valued, and an episode begins
      ++carried_there;
      EXPECT_EQ(trajectories.action[3], kNoAction);
      EXPECT_TRUE(shard.inputs.first[4]);
      EXPECT_EQ(shard.inputs.position[4], 14);
    } else {
      ++carried_on;
      // The step from 14 to 15 leads nearer than ever to goals beyond only.
      EXPECT_EQ(trajectories.reward[3], goal == 15 ? 1.0f : goal > 15 ? 0.0f : -0.01f) << goal;
    }
  }
  EXPECT_GT(reached_before, 1);
  EXPECT_GT(carried_there, 1);
  EXPECT_GT(carried_on, 20);
}

TEST(Relabel, GoalsAreVisitedOrAnyOther) {
  Rollout rollout = walk_along({1, 1, 0, 1, 1, -1, -1, 1, 1, 1, 1, 1}, {4});
  Rollout* const rollouts[] = {&rollout};
  Replay replay(100);
  replay.add(rollouts);
  RelabelMap map = line(20);
  std::vector<int> visited(20), any(20);
  for (std::uint64_t seed = 0; seed < 2000; ++seed) {
    Random one{seed}, other{seed};
    ++visited[static_cast<std::size_t>(choose_goal(replay, 0, 1, 1, map, one))];
    ++any[static_cast<std::size_t>(choose_goal(replay, 0, 1, 0, map, other))];
  }
  for (std::size_t place = 0; place < 20; ++place) {
    // From place 6 the stretch comes by 7 (twice), 8 and 9.
    EXPECT_EQ(visited[place] > 0, place >= 7 && place <= 9) << place;
    EXPECT_EQ(any[place] > 0, place != 6) << place;
  }
}

TEST(Replay, KeepsTheLastSequences) {
  Replay replay(24);  // two sequences of 12
  const std::vector<std::vector<int>> walks = {
      {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1}, std::vector<int>(12, 0), {-1, -1, -1, -1, -1, 1, 1, 1, 1, 1, 1, 1}};
  for (const std::vector<int>& moves : walks) {
    Rollout rollout = walk_along(moves, {});
    Rollout* const rollouts[] = {&rollout};
    replay.add(rollouts);
  }
  ASSERT_EQ(replay.size(), 2u);
  EXPECT_EQ(replay.position(replay.at(1, 12)), 5);  // the second one stayed
  EXPECT_EQ(replay.position(replay.at(0, 5)), 0);   // the third one is in the place of the first
  EXPECT_EQ(replay.action(replay.at(0, 11)), kNext);
  EXPECT_EQ(replay.action(replay.at(0, 12)), kNoAction);
  EXPECT_EQ(replay.seen(replay.at(0, 12))(0), 12);
  Rollout other_lesson = walk_along(walks[1], {});
  other_lesson.max_steps = 7;
  Rollout* const rollouts[] = {&other_lesson};
  replay.add(rollouts);
  EXPECT_EQ(replay.size(), 1u);
}

}  // namespace
}  // namespace citylearn
