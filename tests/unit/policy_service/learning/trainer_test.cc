// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/trainer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>

#include "core/util/error.h"
#include "policy_service/learning/optimization/adam.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/rollout/network_policy.h"
#include "tests/support/env/env.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class EachNetwork : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Networks, EachNetwork, ::testing::Values("baseline", "features", "place_filter", "raw_images"),
                         [](const auto& tested) { return tested.param; });

TEST_P(EachNetwork, LearnsFromSeveralExperiencesAlike) {
  const Traversal city = small_city_for(GetParam()), other = other_season(city);
  for (const std::string learner : {"ppo", "relabel"}) {
    TrainerOptions options = small_options(GetParam());
    options.learner = learner;
    expect_reproducible({&city, &other}, options, 2, 4);
    expect_resumable({&city, &other}, options, 3, 3);
    Loop alone(city, options, 2), both({&city, &other}, options, 2), turned({&other, &city}, options, 2);
    for (Loop* loop : {&alone, &both, &turned}) loop->update();
    if (GetParam() != "baseline") {
      EXPECT_NE(alone.trainer.agent().parameters, both.trainer.agent().parameters) << "sees the other season";
      EXPECT_TRUE(contains(error_of([&] { turned.trainer.load(both.trainer.checkpoint()); }), "features are others"));
    }
  }
}

TEST(Trainer, ASnapshotChangesNothingAndBeginsAGenerationOfItsOwn) {
  const Traversal city = small_city();
  Loop watched(city, small_options("features")), alone(city, small_options("features"));
  Checkpoint snapshot;
  for (int i = 0; i < 3; ++i) {
    watched.update();
    alone.update();
    snapshot = watched.trainer.snapshot();
  }
  EXPECT_EQ(watched.trainer.agent().parameters, alone.trainer.agent().parameters);
  EXPECT_EQ(watched.trainer.generation(), alone.trainer.generation());
  Loop again(city, small_options("features"));
  again.trainer.load(snapshot);
  EXPECT_EQ(again.trainer.agent().parameters, watched.trainer.agent().parameters);
  EXPECT_EQ(again.trainer.progress().updates, 3u);
  EXPECT_EQ(again.trainer.generation(), watched.trainer.generation() + 1);
}

TEST(Trainer, RefusesAnExperienceThatItDoesNotKnow) {
  const Traversal city = small_city();
  Trainer trainer(small_options("features"), task_of(city));
  EXPECT_TRUE(contains(error_of([&] { trainer.add(0, 4, 1); }), "experience of environment 0: is not known"));
}

TEST(Trainer, RefusesACheckpointOfOtherOptions) {
  const Traversal city = small_city();
  Loop loop(city, small_options("baseline"));
  const Checkpoint checkpoint = loop.trainer.checkpoint();
  TrainerOptions options = small_options("baseline");
  options.learner_parameters["gamma"] = 0.5;
  Loop other(city, options);
  EXPECT_TRUE(contains(error_of([&] { other.trainer.load(checkpoint); }), "learner_parameters.gamma was "));
  Traversal changed = city;
  changed.features[3] += 1;
  Loop elsewhere(changed, small_options("baseline"));
  EXPECT_THROW(elsewhere.trainer.load(checkpoint), Error);
}

/// However many agents are under way, whose steps belong to no finished episode.
TEST(Trainer, TheEpisodeLengthIsThatOfFinishedEpisodes) {
  const Traversal city = small_city();
  Loop loop(city, small_options("baseline"));
  EXPECT_TRUE(std::isnan(loop.trainer.progress().episode_length));
  while (loop.trainer.progress().episodes == 0) loop.update();
  const double length = loop.trainer.progress().episode_length;
  EXPECT_GE(length, 1);
  EXPECT_LE(length, city.frames) << "the step limit";
  Loop resumed(city, small_options("baseline"));
  resumed.trainer.load(loop.trainer.checkpoint());
  EXPECT_EQ(resumed.trainer.progress().episode_length, length);
  Checkpoint old = loop.trainer.checkpoint();
  old.header["progress"].erase("recent_steps");
  resumed.trainer.load(old);
  EXPECT_TRUE(std::isnan(resumed.trainer.progress().episode_length));
}

/// A trainer's parameters that belong to tensor `name`.
Vector<float> part(const Trainer& trainer, const std::string& name) {
  const TrainedAgent agent = trainer.agent();
  for (const Tensor& tensor : agent.network->tensors())
    if (tensor.name == name) return agent.parameters.segment(tensor.offset, tensor.rows * tensor.cols);
  throw Error("has no tensor " + name);
}

void expect_refusal(const TrainerOptions& options, const Traversal& city, const std::string& part) {
  EXPECT_TRUE(contains(error_of([&] { Trainer(options, task_of(city)); }), part));
}

TEST_P(EachNetwork, BeginsWithATrainedAgentOnAnotherRoute) {
  const Traversal city = small_city_for(GetParam());
  Loop loop(city, small_options(GetParam()));
  for (int i = 0; i < 3; ++i) loop.update();
  TrainerOptions options = small_options(GetParam(), 2);
  options.initial = loop.trainer.agent();
  Traversal other = city;
  for (float& value : other.features) value = -value;
  Loop again(other, options);
  EXPECT_EQ(again.trainer.agent().parameters, loop.trainer.agent().parameters);
  EXPECT_EQ(again.trainer.progress().updates, 0u);
  again.update();
  EXPECT_NE(again.trainer.agent().parameters, loop.trainer.agent().parameters);
}

class EachDescent : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Learners, EachDescent, ::testing::Values("ppo", "vtrace", "relabel"),
                         [](const auto& tested) { return tested.param; });

TEST_P(EachDescent, FrozenTensorsStayBitForBitAlsoWhenItGoesOn) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("features");
  options.learner = GetParam();
  options.frozen = {"lstm", "heads.weight"};
  Loop loop(city, options);
  EXPECT_EQ(loop.trainer.frozen(),
            (std::vector<std::string>{"lstm.input", "lstm.recurrent", "lstm.bias", "heads.weight"}));
  const std::vector<std::string> learning = {"sensors.weight", "sensors.bias", "heads.bias"};
  const Trainer start(options, task_of(city));
  const auto expect_frozen = [&](const Trainer& trainer) {
    for (const std::string& name : trainer.frozen()) EXPECT_EQ(part(trainer, name), part(start, name)) << name;
    for (const std::string& name : learning) EXPECT_NE(part(trainer, name), part(start, name)) << name;
  };
  for (int i = 0; i < 3; ++i) loop.update();
  expect_frozen(loop.trainer);

  const Checkpoint checkpoint = loop.trainer.checkpoint();
  Loop resumed(city, options);
  resumed.trainer.load(checkpoint);
  for (int i = 0; i < 2; ++i) {
    loop.update();
    resumed.update();
  }
  expect_frozen(resumed.trainer);
  EXPECT_EQ(resumed.trainer.agent().parameters, loop.trainer.agent().parameters);
}

/// The share of the others in a step must not depend on gradients that are dropped.
TEST_P(EachDescent, WhatIsFrozenHasNoShareInTheGradientsLength) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("features");
  options.learner = GetParam();
  const double whole = Loop(city, options).update().gradient_norm;
  options.frozen = {"sensors", "lstm", "heads.weight", "auxiliary"};
  const double rest = Loop(city, options).update().gradient_norm;
  EXPECT_GT(rest, 0);
  EXPECT_LT(rest, 0.9 * whole);
}

TEST(Trainer, ACheckpointGoesOnWithTheSameFrozenTensorsAlone) {
  const Traversal city = small_city();
  TrainerOptions free = small_options("features"), frozen = free;
  frozen.frozen = {"lstm"};
  Loop without(city, free), with(city, frozen);
  const Checkpoint made_without = without.trainer.checkpoint(), made_with = with.trainer.checkpoint();
  EXPECT_NO_THROW(with.trainer.load(made_with));
  for (const auto& [trainer, checkpoint] :
       {std::pair{&without.trainer, &made_with}, std::pair{&with.trainer, &made_without}}) {
    const std::string refusal =
        error_of([&trainer = trainer, &checkpoint = checkpoint] { trainer->load(*checkpoint); });
    EXPECT_TRUE(contains(refusal, "frozen was "));
    EXPECT_TRUE(contains(refusal, "lstm.recurrent"));
  }
}

TEST(Trainer, SaysWhyAnInitialAgentDoesNotFit) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("features");
  options.network_parameters["cells"] = 8;
  TrainerOptions wider = small_options("features");
  wider.initial = Trainer(options, task_of(city)).agent();
  expect_refusal(wider, city, "tensor 'lstm.input' is 32 x");
  wider.initial = Trainer(small_options("baseline"), task_of(city)).agent();
  expect_refusal(wider, city, "is a 'baseline', the one to train a 'features'");
  wider.initial = Trainer(small_options("features"), task_of(city)).agent();
  wider.initial->parameters[5] = NAN;
  expect_refusal(wider, city, "not finite");
  TrainerOptions told = small_options("place_filter"), learns = told;
  told.network_parameters["slip"] = 0;
  learns.initial = Trainer(told, task_of(city)).agent();
  expect_refusal(learns, city, "head.out.bias (train with the network parameters that it had)");
}

TEST(Trainer, SaysWhyTensorsCannotBeFrozen) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("features");
  options.frozen = {"lstm", "attention"};
  expect_refusal(options, city, "'attention' (it has sensors.weight, sensors.bias, lstm.input");
  options.frozen = {"sensors", "lstm", "heads", "auxiliary"};
  expect_refusal(options, city, "nothing is left to learn");
}

TEST(Trainer, SaysWhatIsWrong) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("baseline");
  options.trainer_parameters["sequence"] = 7;
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  options = small_options("baseline");
  options.learner_parameters["speed"] = 7;
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  options = small_options("nobody");
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  EXPECT_THROW(Trainer(small_options("place_filter"), NetworkTask{12, 16, {}}), Error);

  Trainer trainer(small_options("baseline"), task_of(city));
  EXPECT_FALSE(trainer.ready());
  EXPECT_THROW(trainer.update(), Error);
  Environment environment(city, 3);
  msg::TaskSettings settings;
  trainer.settings(0, settings);
  environment.reset(settings);
  msg::Observation observation;
  environment.observe(observation);
  std::vector<std::uint8_t> choice;
  EXPECT_THROW(trainer.act(0, observation, choice), Error);  // never added
  trainer.add(0, 4);
  EXPECT_THROW(trainer.act(0, observation, choice), Error);  // another number of agents
  trainer.add(0, 3);
  EXPECT_TRUE(trainer.act(0, observation, choice));
  EXPECT_THROW(trainer.act(0, observation, choice), Error);  // the same step again
  EXPECT_THROW(trainer.resume(0, choice), Error);
}

TEST(Trainer, GoesThroughTheLessons) {
  const Traversal city = small_city();
  TrainerOptions options = small_options("baseline");
  options.curriculum = true;
  options.learner_parameters["learning-rate"] = 3e-3;
  Loop loop(city, options, 2, 8);
  msg::TaskSettings settings;
  loop.trainer.settings(0, settings);
  EXPECT_EQ(settings.frames(), 4u);
  EXPECT_EQ(settings.max_steps(), 16u);
  const std::uint64_t first_seed = settings.seed();
  for (int i = 0; i < 300 && loop.trainer.progress().lesson == 0; ++i) loop.update();
  ASSERT_EQ(loop.trainer.progress().lesson, 1);
  EXPECT_EQ(loop.trainer.generation(), 1u);
  EXPECT_GT(loop.trainer.progress().smoothed_reward, 0.95);
  EXPECT_GE(loop.trainer.progress().episodes, 100u);
  loop.trainer.settings(0, settings);
  EXPECT_EQ(settings.lesson(), 1u);
  EXPECT_EQ(settings.frames(), 8u);
  EXPECT_NE(settings.seed(), first_seed);
  loop.update();
  EXPECT_TRUE(std::isfinite(loop.trainer.progress().reward));
}

/// Settings of so many tasks on the whole city.
msg::TaskSettings all_places(const Traversal& city, std::uint32_t tasks) {
  const auto frames = static_cast<std::uint32_t>(city.frames);
  msg::TaskSettings all = settings(msg::EVALUATE, frames, frames, 0);
  all.tasks() = tasks;
  return all;
}

double spl(const TrainedAgent& agent, const Traversal& city, bool greedy) {
  Environment environment(city, 50);
  environment.reset(all_places(city, 200));
  NetworkPolicy policy(agent, {.seed = 5, .greedy = greedy});
  msg::Observation observation;
  std::vector<std::uint8_t> choice;
  double sum = 0;
  while (!environment.done()) {
    environment.observe(observation);
    policy.act(observation, choice);
    environment.step(choice);
    for (const auto& episode : environment.finished())
      if (episode.completed) sum += static_cast<double>(episode.shortest) / std::max(episode.shortest, episode.steps);
  }
  return sum / 200;
}

/// Agents whose tasks are done do not disturb the others.
TEST_P(EachNetwork, ActsAsIfIdleAgentsWereNotThere) {
  const Traversal city = small_city_for(GetParam());
  TrainerOptions options = small_options(GetParam());
  Loop loop(city, options, 1, 6);
  loop.update();
  const TrainedAgent agent = loop.trainer.agent();
  Environment environment(city, 6);
  environment.reset(all_places(city, 600));
  const std::set<std::size_t> idle = {0, 3, 4};
  NetworkPolicy everybody(agent, {.seed = 5, .greedy = false}), few(agent, {.seed = 5, .greedy = false});
  msg::Observation observation;
  std::vector<std::uint8_t> choice, expected;
  for (int step = 0; step < 12; ++step) {
    environment.observe(observation);
    msg::Observation marked = observation;
    for (const std::size_t agent_index : idle) marked.flags()[agent_index] |= msg::FLAG_IDLE;
    few.act(marked, choice);
    ASSERT_EQ(choice.size(), 6u);
    everybody.act(observation, expected);
    for (std::size_t index = 0; index < 6; ++index)
      EXPECT_EQ(choice[index], idle.contains(index) ? 0 : expected[index]) << "step " << step;
    environment.step(expected);
  }
  for (std::uint8_t& flags : observation.flags()) flags = msg::FLAG_IDLE;
  few.act(observation, choice);
  EXPECT_EQ(choice, std::vector<std::uint8_t>(6));
}

/// Each network learns the small city, looking at it, within its budget of steps. (A blind sweep has SPL 0.85 or less.)
TEST_P(EachNetwork, LearnsTheSmallCity) {
  const Traversal city = small_city_for(GetParam());
  TrainerOptions options = small_options(GetParam());
  if (GetParam() != "place_filter") options.network_parameters = {{"hidden", 64}, {"cells", 32}};
  if (GetParam() == "raw_images") options.network_parameters["side"] = 28, options.network_parameters["maps"] = 4;
  options.learner_parameters = {{"learning-rate", 3e-3}, {"minibatch", 8}, {"entropy-until", 0.7}, {"gamma", 0.95}};
  options.trainer_parameters = {{"segment", 32},      {"sequence", 16},     {"steps", 80000},
                                {"noise-frame", 0.3}, {"noise-place", 0.3}, {"noise-episode", 0.3}};
  if (GetParam() == "raw_images")  // pictures have no appearance of features, and say where they were taken sooner
    for (const char* noise : {"noise-frame", "noise-place", "noise-episode"}) options.trainer_parameters[noise] = 0;
  Loop loop(city, options, 1, 16);
  while (!loop.trainer.done()) loop.update();
  EXPECT_GT(spl(loop.trainer.agent(), city, false), 0.95);
  EXPECT_GT(spl(loop.trainer.agent(), city, true), 0.95);
  EXPECT_EQ(spl(loop.trainer.agent(), city, false), spl(loop.trainer.agent(), city, false));
  ASSERT_TRUE(loop.trainer.progress().episodes_to_spl95 || GetParam() != "baseline");
}

TEST(PlaceFilter, LearnsHowOftenActionsSlipAndAgentsAreKidnapped) {
  const Traversal city = small_city();
  for (const auto& [slip, kidnappings] : {std::pair(0.0, 0), {0.1, 0}, {0.3, 0}, {0.1, 1}}) {
    TrainerOptions options = small_options("place_filter");
    options.learner_parameters = {{"learning-rate", 6e-3}, {"minibatch", 8}};
    options.trainer_parameters = {{"segment", 32}, {"sequence", 16}, {"steps", 80000}};
    Loop loop(city, options, 1, 16, {.slip = slip, .kidnappings = kidnappings});
    while (!loop.trainer.done()) loop.update();
    const TrainedAgent agent = loop.trainer.agent();
    ASSERT_EQ(agent.network->tensors().at(1).name + agent.network->tensors().at(2).name, "filter.slipfilter.kidnap");
    const auto learned = [&](int parameter) { return 1 / (1 + std::exp(-3 * double{agent.parameters(parameter)})); };
    EXPECT_NEAR(learned(5), slip, 0.02);
    const double rate = kidnappings / loop.trainer.progress().episode_length;  // of the last 100 episodes
    EXPECT_NEAR(learned(6), rate, rate / 3 + 1e-4);
  }
}

TEST(Adam, AGradientThatIsNotFiniteChangesNothing) {
  Adam adam(2, {});
  WorkerPool workers(1);
  Vector<float> parameters = Vector<float>::Ones(2);
  for (const double wrong : {std::nan(""), std::numeric_limits<double>::infinity()}) {
    adam.step(0.1, Vector<float>::Ones(2), wrong, parameters, {}, workers);
    EXPECT_EQ(parameters, Vector<float>::Ones(2)) << wrong;
  }
  adam.step(0.1, Vector<float>::Ones(2), std::sqrt(2.0), parameters, {}, workers);
  EXPECT_LT(parameters.maxCoeff(), 1.0f) << "the next one counts";
}

}  // namespace
}  // namespace citylearn::testing
