// SPDX-License-Identifier: Apache-2.0
// The learner torch_ppo, where it is built: it does what ppo does.
#include <gtest/gtest.h>

#include <cmath>

#include "core/plugin/plugins.h"
#include "policy_service/learning/optimization/ppo_loss.h"
#include "policy_service/network/checkpoint.h"
#include "tests/paths.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class TorchPpo : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef CITYLEARN_TORCH_PPO
    load_plugin(CITYLEARN_TORCH_PPO);
#else
    GTEST_SKIP() << "built without libtorch";
#endif
  }
  WorkerPool workers_{2};
};

constexpr int kFeatures = 5, kFrames = 7, kSteps = 12, kSequence = 6, kAgents = 3;

NetworkTask small_task() { return {kFeatures, kFrames, {}}; }

/// Random, with episodes that begin and end in the middle, ratios to be clipped and masks.
Rollout some_rollout(int state_size, int agents, std::uint64_t seed) {
  Random random{seed};
  Rollout rollout;
  rollout.resize(kFeatures, state_size, kSteps, agents, kSequence);
  rollout.inputs.frames = kFrames;
  for (float& value : rollout.states.reshaped()) value = static_cast<float>(random.normal());
  for (int column = 0; column < kSteps * agents; ++column) {
    const auto i = static_cast<std::size_t>(column);
    const bool first = random.below(5) == 0;
    const int position = static_cast<int>(random.below(kFrames));
    Vector<float> features(kFeatures);
    for (float& value : features) value = static_cast<float>(random.normal());
    rollout.inputs.see(column, -1, features);
    rollout.inputs.position[i] = position;
    rollout.inputs.goal[i] = static_cast<int>(random.below(kFrames));
    rollout.inputs.first[i] = first;
    rollout.inputs.previous_action[i] =
        first ? std::uint8_t{kNoAction} : static_cast<std::uint8_t>(random.below(kActions));
    rollout.inputs.allowed[i] = position == 0 ? 0b011 : position == kFrames - 1 ? 0b101 : 0b111;
    do rollout.action[i] = static_cast<std::uint8_t>(random.below(kActions));
    while (!(rollout.inputs.allowed[i] >> rollout.action[i] & 1));
    rollout.log_probability[i] = static_cast<float>(-1.1 + 0.3 * random.normal());
    rollout.value[i] = static_cast<float>(0.5 * random.normal());
    rollout.reward[i] = static_cast<float>(random.normal());
    rollout.ended[i] = random.below(6) == 0 ? Rollout::kTerminated : Rollout::kGoesOn;
  }
  return rollout;
}

struct Case {
  std::string agent;
  std::map<std::string, double> network, learner;
};

const std::vector<Case> kCases = {
    {"features", {{"hidden", 6}, {"cells", 4}, {"relu", 0}}, {{"localisation", 0.5}, {"orientation", 2}}},
    {"features", {{"hidden", 6}, {"cells", 4}}, {{"value-clip", 0}, {"normalise-advantages", 0}}},
    {"baseline", {{"hidden", 6}, {"cells", 4}, {"mask-input", 0}, {"scale", 2}}, {{"entropy", 0.3}}}};

std::unique_ptr<AgentNetwork<float>> network_of(const Case& one, const NetworkTask& task, Parameters& parameters) {
  const auto& entry = NetworkRegistry<float>::instance().find("network", one.agent);
  parameters = Parameters(entry.name, entry.parameters, one.network);
  return entry.create(parameters, task);
}

std::unique_ptr<Learner> learner_of(const std::string& name, const LearnerTask& task,
                                    const std::map<std::string, double>& values) {
  const auto& entry = LearnerRegistry::instance().find("learner", name);
  return entry.create(Parameters(entry.name, entry.parameters, values), task);
}

/// One step of Adam with a large epsilon moves each parameter by its gradient divided by (epsilon + the gradient's
/// size).
TEST_F(TorchPpo, GradientsAndLossesAreOurs) {
  for (const Case& one : kCases) {
    const NetworkTask task = small_task();
    Parameters parameters;
    const auto network = network_of(one, task, parameters);
    std::map<std::string, double> values = {
        {"epochs", 1}, {"minibatch", 100}, {"learning-rate", 1}, {"adam-epsilon", 1}, {"gradient-norm", 1e6}};
    values.insert(one.learner.begin(), one.learner.end());
    const LearnerTask learner_task{*network, one.agent, parameters, task, workers_, 3, 0};
    Vector<float> moved[2];
    UpdateFigures figures[2];
    for (const int which : {0, 1}) {
      Rollout first = some_rollout(network->state_size(), kAgents, 8);
      Rollout second = some_rollout(network->state_size(), 1, 9);
      Rollout* const rollouts[] = {&first, &second};
      const auto learner = learner_of(which == 0 ? "ppo" : "torch_ppo", learner_task, values);
      const Vector<float> before = learner->parameters();
      figures[which] = learner->update(rollouts);
      moved[which] = before - learner->parameters();
    }
    const auto gradient = [](const Vector<float>& move) { return (move.array() / (1 - move.array().abs())).eval(); };
    const auto ours = gradient(moved[0]), theirs = gradient(moved[1]);
    ASSERT_GT(ours.abs().maxCoeff(), 0.01f) << one.agent;
    EXPECT_LE((ours - theirs).abs().maxCoeff(), 1e-4f * ours.abs().maxCoeff()) << one.agent;
    const auto near = [&](double a, double b) { EXPECT_NEAR(a, b, 1e-4 * std::max(1.0, std::abs(a))) << one.agent; };
    near(figures[0].policy_loss, figures[1].policy_loss);
    near(figures[0].value_loss, figures[1].value_loss);
    near(figures[0].entropy, figures[1].entropy);
    near(figures[0].approx_kl, figures[1].approx_kl);
    near(figures[0].clip_fraction, figures[1].clip_fraction);
    near(figures[0].localisation_loss, figures[1].localisation_loss);
    near(figures[0].orientation_loss, figures[1].orientation_loss);
    near(figures[0].gradient_norm, figures[1].gradient_norm);
    EXPECT_GT(figures[1].clip_fraction, 0) << one.agent;
    EXPECT_EQ(figures[1].localisation_loss > 0, one.learner.contains("localisation")) << one.agent;
  }
}

/// Shuffles, schedules, clipping of the gradient and Adam's memory, over several updates.
TEST_F(TorchPpo, WholeUpdatesAreOurs) {
  const Case& one = kCases[0];
  const NetworkTask task = small_task();
  Parameters parameters;
  const auto network = network_of(one, task, parameters);
  Vector<float> learned[2];
  for (const int which : {0, 1}) {
    const auto learner = learner_of(
        which == 0 ? "ppo" : "torch_ppo", LearnerTask{*network, one.agent, parameters, task, workers_, 3, 400},
        {{"minibatch", 2}, {"entropy-until", 0.5}, {"localisation", 1}, {"adam-epsilon", 0.1}});
    for (std::uint64_t update = 0; update < 4; ++update) {
      Rollout rollout = some_rollout(network->state_size(), kAgents, 20 + update);
      Rollout* const rollouts[] = {&rollout};
      learner->update(rollouts);
    }
    learned[which] = learner->parameters();
  }
  EXPECT_LE((learned[0] - learned[1]).array().abs().maxCoeff(), 1e-4f);
}

TEST_F(TorchPpo, ExtremeProbabilitiesLeaveNumbers) {
  const Case& one = kCases[0];
  const NetworkTask task = small_task();
  Parameters parameters;
  const auto network = network_of(one, task, parameters);
  const auto learner =
      learner_of("torch_ppo", LearnerTask{*network, one.agent, parameters, task, workers_, 3, 400}, {});
  Rollout rollout = some_rollout(network->state_size(), kAgents, 30);
  for (std::size_t i = 0; i < rollout.action.size(); ++i) rollout.log_probability[i] = i % 2 ? -200.0f : 0.0f;
  Rollout* const rollouts[] = {&rollout};
  learner->update(rollouts);
  EXPECT_TRUE(learner->parameters().allFinite());
}

TEST_F(TorchPpo, SaysWhichNetworksItKnows) {
  TrainerOptions options;
  options.agent = "place_filter";
  options.learner = "torch_ppo";
  const Traversal city = small_city();
  EXPECT_TRUE(
      contains(error_of([&] { Trainer trainer(options, task_of(city)); }), "features and baseline, not place_filter"));
}

TrainerOptions small(const std::string& agent) {
  TrainerOptions options = small_options(agent);
  options.learner = "torch_ppo";
  options.learner_parameters["gpu"] = 0;
  return options;
}

TEST_F(TorchPpo, SameSeedSameBitsAndGoesOnFromACheckpoint) {
  const Traversal city = small_city();
  expect_reproducible(city, small("features"), 2, 3);
  expect_resumable(city, small("features"), 3, 3);

  Loop again(city, small("features"), 2);
  for (int i = 0; i < 3; ++i) again.update();
  const Checkpoint checkpoint = again.trainer.checkpoint();
  const Vector<float> before = again.trainer.agent().parameters;
  for (const char* damage : {"learner.adam.first", "learner.parameters"}) {
    Checkpoint damaged = checkpoint;
    damaged.tensors[damage].conservativeResize(3, 1);
    EXPECT_THROW(again.trainer.load(damaged), Error) << damage;
    EXPECT_EQ(again.trainer.agent().parameters, before) << damage;
  }
}

/// Looking at it: a blind sweep has SPL 0.85 or less.
TEST_F(TorchPpo, LearnsTheSmallCity) {
  const Traversal city = small_city();
  TrainerOptions options = small("baseline");
  options.network_parameters = {{"hidden", 64}, {"cells", 32}};
  options.learner_parameters = {{"learning-rate", 3e-3}, {"minibatch", 8}, {"entropy-until", 0.7}, {"gamma", 0.95}};
  options.trainer_parameters = {{"segment", 32}, {"sequence", 16}, {"steps", 80000}};
  Loop loop(city, options, 1, 16);
  while (!loop.trainer.done() && !loop.trainer.progress().episodes_to_spl95) loop.update();
  EXPECT_TRUE(loop.trainer.progress().episodes_to_spl95) << loop.trainer.progress().spl;
}

}  // namespace
}  // namespace citylearn::testing
