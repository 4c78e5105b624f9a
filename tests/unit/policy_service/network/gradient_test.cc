// SPDX-License-Identifier: Apache-2.0
// Each network's backward pass and PPO's loss, against central differences in double precision.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "core/wire/messages.h"
#include "policy_service/learning/optimization/ppo_loss.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/network/layers/layers.h"
#include "policy_service/rollout/rollout.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/streets.h"

namespace citylearn {
namespace {

constexpr int kFrames = 7;

PpoSamples<double> some_samples(const NetworkInputs<double>& inputs, const Heads<double>& heads) {
  Random random{3};
  PpoSamples<double> samples;
  samples.resize(inputs.goal.size());
  for (std::size_t i = 0; i < inputs.goal.size(); ++i) {
    const auto logits = heads.logits.col(static_cast<std::ptrdiff_t>(i));
    do samples.action[i] = static_cast<std::uint8_t>(random.below(kActions));
    while (logits(samples.action[i]) < 0.5 * kMasked);
    const double log_p = logits(samples.action[i]) - std::log(logits.array().exp().sum());
    samples.log_probability[i] = log_p + 0.3 * random.normal();  // some ratios are clipped
    samples.advantage[i] = random.normal();
    samples.value[i] = heads.values(0, static_cast<std::ptrdiff_t>(i)) + 0.3 * random.normal();
    samples.target[i] = random.normal();
  }
  return samples;
}

struct Case {
  std::string network;
  std::map<std::string, double> parameters;
  int frames = kFrames;
  double localisation = 0;
  int experiences = 1;
  bool streets = false;
};

std::ostream& operator<<(std::ostream& out, const Case& one) { return out << one.network; }

class Gradients : public ::testing::TestWithParam<Case> {};

TEST_P(Gradients, AgreeWithCentralDifferences) {
  const NetworkTask task = GetParam().streets
                               ? street_task(testing::small_states())
                               : small_task(small_network(GetParam().network).features, GetParam().experiences);
  const auto& entry = NetworkRegistry<double>::instance().find("network", GetParam().network);
  const auto network = entry.create(Parameters(entry.name, entry.parameters, GetParam().parameters), task);
  Random random{4};
  Vector<double> parameters;
  network->initialise(random, parameters);
  for (double& value : parameters) value += 0.1 * random.normal();  // no zeros, no tiny policy
  const NetworkInputs<double> inputs = some_inputs(task, GetParam().frames);
  const Matrix<double> state = some_state(*network, inputs.agents);

  const auto workspace = network->make_workspace();
  workspace->localise = GetParam().localisation > 0;
  network->forward(parameters, inputs, state, *workspace);
  const PpoSamples<double> samples = some_samples(inputs, workspace->heads);
  PpoWeights weights;
  weights.value_clip = 0.2;
  weights.entropy = 0.3;
  weights.localisation = GetParam().localisation;
  weights.orientation = 2 * GetParam().localisation;
  const double share = 1.0 / static_cast<double>(inputs.goal.size());
  Heads<double> derivative, unused;
  const auto loss = [&] {
    network->forward(parameters, inputs, state, *workspace);
    return share * ppo_loss(weights, samples, inputs, kFrames, workspace->heads, share, unused).loss;
  };
  ppo_loss(weights, samples, inputs, kFrames, workspace->heads, share, derivative);
  Vector<double> gradient = Vector<double>::Zero(parameters.size());
  network->backward(parameters, inputs, *workspace, derivative, gradient);

  const Tensor joined = network->joined_weights();
  if (joined.cols > 0) {
    workspace->joins = true;
    network->forward(parameters, inputs, state, *workspace);
    Vector<double> others = Vector<double>::Zero(parameters.size());
    network->backward(parameters, inputs, *workspace, derivative, others);
    auto left_out = others.segment(joined.offset, joined.rows * joined.cols);
    EXPECT_TRUE(left_out.isZero(0));
    left_out = (*workspace->left * workspace->right->transpose()).reshaped();
    EXPECT_TRUE(others.isApprox(gradient, 1e-12));
  }
  for (const Tensor& tensor : network->tensors()) {
    double largest_error = 0, largest = 0;
    const std::ptrdiff_t told = tensor.offset == 0 && !task.streets ? small_network(GetParam().network).told : 0;
    EXPECT_EQ(gradient.segment(tensor.offset, told).norm(), 0);
    for (std::ptrdiff_t i = tensor.offset + told; i < tensor.offset + tensor.rows * tensor.cols; ++i) {
      const double numeric = central_difference(parameters(i), loss);
      largest_error = std::max(largest_error, std::abs(numeric - gradient(i)));
      largest = std::max({largest, std::abs(numeric), std::abs(gradient(i))});
    }
    const bool unused_head = tensor.name.starts_with("auxiliary.") && GetParam().localisation == 0;
    EXPECT_EQ(largest > 1e-7, !unused_head) << tensor.name;
    EXPECT_LE(largest_error, 1e-6 * std::max(largest, 1e-3)) << tensor.name;
  }
}

const std::map<std::string, double> kSmallFilter = {{"units", 5}, {"slip", 0}};
const std::map<std::string, double> kSmall = {{"hidden", 6}, {"cells", 4}};

INSTANTIATE_TEST_SUITE_P(Networks, Gradients,
                         ::testing::Values(Case{"features", {{"hidden", 6}, {"cells", 4}, {"relu", 0}}, kFrames, 0.5},
                                           Case{"features", kSmall, kFrames, 0},
                                           Case{"baseline", {{"hidden", 6}, {"cells", 4}, {"mask-input", 0}}},
                                           Case{"place_filter", kSmallFilter},
                                           Case{"place_filter", kSmallFilter, kFrames - 2},
                                           Case{"place_filter", {{"units", 5}, {"slip", 0.2}, {"kidnap", 0.1}}},
                                           Case{"place_filter", kSmallFilter, kFrames, 0, 2},
                                           Case{"place_filter", {{"units", 5}, {"slip", 0.1}}, 13, 0, 1, true},
                                           Case{"raw_images", small_network("raw_images").parameters, kFrames, 0.5}),
                         [](const auto& tested) { return tested.param.network + std::to_string(tested.index); });

/// Told .2 and .1 as first guesses; its loss is the mean over all columns of -log P(where an action led).
TEST(PlaceFilter, LearnsFromWhereActionsLedHowOftenTheySlipAndAgentsAreKidnapped) {
  const NetworkTask task = small_task(5);
  const auto& entry = NetworkRegistry<double>::instance().find("network", "place_filter");
  const auto network = entry.create(Parameters(entry.name, entry.parameters, {{"units", 5}}), task);
  const Tensor &slip = network->tensors().at(1), &kidnap = network->tensors().at(2);
  ASSERT_EQ(slip.name + " " + kidnap.name, "filter.slip filter.kidnap");
  Vector<double> parameters = Vector<double>::Zero(network->parameter_count());
  parameters(slip.offset) = std::log(0.2 / 0.8) / 3;
  parameters(kidnap.offset) = std::log(0.1 / 0.9) / 3;
  // By `next` from 2 with the goal 0: once, never, twice, once. From 5, before the end: to 6. From 3 with the goal 4,
  // where only slips are seen: never. From 2 to 5, where no step leads.
  const std::vector<std::array<int, 3>> walk = {{2, 3, 0}, {2, 2, 0}, {2, 4, 0}, {2, 3, 0},
                                                {5, 6, 0}, {3, 3, 4}, {2, 5, 0}};
  NetworkInputs<double> inputs;
  inputs.resize(task.features, 2, static_cast<int>(walk.size()));
  inputs.frames = kFrames;
  for (std::size_t agent = 0; agent < walk.size(); ++agent)
    for (const std::size_t t : {0, 1}) {
      const std::size_t column = t * walk.size() + agent;
      inputs.position[column] = walk[agent][t];
      inputs.goal[column] = walk[agent][2];
      inputs.first[column] = t == 0;
      inputs.previous_action[column] = t == 0 ? std::uint8_t{kNoAction} : std::uint8_t{kNext};
    }
  Vector<double> gradient = Vector<double>::Zero(parameters.size());
  network->add_model_gradient(parameters, inputs, gradient);
  // P = .9 W + .1 / N; W: once 1 - p, never and twice p / 2 each, at the end 1 - p / 2, and 0 where no step leads.
  constexpr double kAnywhere = 1.0 / kFrames;
  const double once = 0.9 * 0.8 + 0.1 * kAnywhere, slipped = 0.9 * 0.1 + 0.1 * kAnywhere,
               end = 0.9 * 0.9 + 0.1 * kAnywhere, leapt = 0.1 * kAnywhere;
  const double by_slip = 0.9 * (2 / once - 2 * 0.5 / slipped + 0.5 / end);
  const double by_kidnap =
      2 * (0.8 - kAnywhere) / once + 2 * (0.1 - kAnywhere) / slipped + (0.9 - kAnywhere) / end - kAnywhere / leapt;
  EXPECT_NEAR(gradient(slip.offset), 3 * 0.2 * 0.8 * by_slip / 14, 1e-12);
  EXPECT_NEAR(gradient(kidnap.offset), 3 * 0.1 * 0.9 * by_kidnap / 14, 1e-12);
  gradient(slip.offset) = gradient(kidnap.offset) = 0;
  EXPECT_EQ(gradient.norm(), 0);
}

/// One agent: goes on, ends at its goal, goes on, is cut by its step limit, goes on.
TEST(Rollout, AdvantagesKnowEndsAndCuts) {
  Rollout rollout;
  rollout.resize(0, 1, 5, 1, 5);
  rollout.reward = {-1, 1, -1, -1, -1};
  rollout.value = {0.1f, 0.2f, 0.3f, 0.4f, 0.5f};
  rollout.ended = {Rollout::kGoesOn, Rollout::kTerminated, Rollout::kGoesOn, Rollout::kTruncated, Rollout::kGoesOn};
  rollout.final_value = {0, 0, 0, 7, 0};
  rollout.last_value = {9};
  const double gamma = 0.9, lambda = 0.8;
  rollout.estimate_advantages(gamma, lambda);
  const double a4 = -1 + gamma * 9 - 0.5, a3 = -1 + gamma * 7 - 0.4, a2 = -1 + gamma * 0.4 - 0.3 + gamma * lambda * a3;
  const double a1 = 1 - 0.2, a0 = -1 + gamma * 0.2 - 0.1 + gamma * lambda * a1;
  const double expected[] = {a0, a1, a2, a3, a4};
  for (std::size_t i = 0; i < 5; ++i) {
    EXPECT_NEAR(rollout.advantage[i], expected[i], 1e-6) << i;
    EXPECT_NEAR(rollout.target[i], expected[i] + static_cast<double>(rollout.value[i]), 1e-6) << i;
  }
}

}  // namespace
}  // namespace citylearn
