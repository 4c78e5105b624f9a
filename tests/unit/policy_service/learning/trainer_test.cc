// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/trainer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

#include "core/task/route_map.h"
#include "core/util/error.h"
#include "core/util/files.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/network_policy.h"
#include "tests/support/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TrainerOptions small(const std::string& agent, std::uint64_t seed = 1) {
  TrainerOptions options;
  options.agent = agent;
  options.seed = seed;
  if (agent != "place_filter") options.network_parameters = {{"hidden", 24}, {"cells", 16}};
  if (agent == "raw_images") options.network_parameters = small_network(agent).parameters;
  options.learner_parameters = {{"minibatch", 3}, {"epochs", 2}};
  options.trainer_parameters = {{"segment", 24}, {"sequence", 12}, {"steps", 20000}};
  return options;
}

class EachNetwork : public ::testing::TestWithParam<std::string> {};
INSTANTIATE_TEST_SUITE_P(Networks, EachNetwork,
                         ::testing::Values("baseline", "features", "place_filter", "place_memory", "raw_images"),
                         [](const auto& tested) { return tested.param; });

TEST_P(EachNetwork, SameSeedSameBitsWhoeverComesFirst) {
  const Traversal city = small_city_for(GetParam());
  Loop one(city, small(GetParam()), 2), other(city, small(GetParam()), 2), third(city, small(GetParam(), 2), 2);
  for (int i = 0; i < 6; ++i) {
    one.update();
    other.update(/*backwards=*/i % 2 == 0);
    third.update();
  }
  EXPECT_EQ(one.trainer.agent().parameters, other.trainer.agent().parameters);
  EXPECT_NE(one.trainer.agent().parameters, third.trainer.agent().parameters);
  EXPECT_EQ(one.trainer.progress().episodes, other.trainer.progress().episodes);
  EXPECT_EQ(one.trainer.progress().spl, other.trainer.progress().spl);
  EXPECT_EQ(one.trainer.progress().steps, 6u * 2 * 4 * 24);
}

TEST_P(EachNetwork, GoesOnFromACheckpointByteForByte) {
  const Traversal city = small_city_for(GetParam());
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / ("go_on_" + GetParam());
  std::filesystem::create_directories(folder);
  const std::string middle = folder / "middle", straight = folder / "straight", resumed = folder / "resumed";
  Loop loop(city, small(GetParam()), 2);
  for (int i = 0; i < 5; ++i) loop.update();
  write_checkpoint(middle, loop.trainer.checkpoint("{\"note\": 1}"));
  for (int i = 0; i < 5; ++i) loop.update();
  write_checkpoint(straight, loop.trainer.checkpoint("{\"note\": 1}"));

  Loop again(city, small(GetParam()), 2);
  again.trainer.load(read_checkpoint(middle));
  EXPECT_EQ(again.trainer.progress().updates, 5u);
  for (int i = 0; i < 5; ++i) again.update();
  write_checkpoint(resumed, again.trainer.checkpoint("{\"note\": 1}"));
  EXPECT_EQ(read_file(straight), read_file(resumed));
  EXPECT_NE(read_file(straight), read_file(middle));
}

TEST(Trainer, RefusesACheckpointOfOtherOptions) {
  const Traversal city = small_city();
  Loop loop(city, small("baseline"));
  const Checkpoint checkpoint = loop.trainer.checkpoint();
  TrainerOptions options = small("baseline");
  options.learner_parameters["gamma"] = 0.5;
  Loop other(city, options);
  EXPECT_TRUE(contains(error_of([&] { other.trainer.load(checkpoint); }), "learner_parameters.gamma was "));
  Traversal changed = city;
  changed.features[3] += 1;
  Loop elsewhere(changed, small("baseline"));
  EXPECT_THROW(elsewhere.trainer.load(checkpoint), Error);
}

/// A trainer's parameters that belong to tensor `name`.
Vector<float> part(const Trainer& trainer, const std::string& name) {
  const TrainedAgent agent = trainer.agent();
  for (const Tensor& tensor : agent.network->tensors())
    if (tensor.name == name) return agent.parameters.segment(tensor.offset, tensor.rows * tensor.cols);
  throw Error("has no tensor " + name);
}

std::string refusal(const TrainerOptions& options, const Traversal& city) {
  return error_of([&] { Trainer(options, task_of(city)); });
}

TEST_P(EachNetwork, BeginsWithATrainedAgentOnAnotherRoute) {
  const Traversal city = small_city_for(GetParam());
  Loop loop(city, small(GetParam()));
  for (int i = 0; i < 3; ++i) loop.update();
  TrainerOptions options = small(GetParam(), 2);
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
  TrainerOptions options = small("features");
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
  TrainerOptions options = small("features");
  options.learner = GetParam();
  const double whole = Loop(city, options).update().gradient_norm;
  options.frozen = {"sensors", "lstm", "heads.weight", "auxiliary"};
  const double rest = Loop(city, options).update().gradient_norm;
  EXPECT_GT(rest, 0);
  EXPECT_LT(rest, 0.9 * whole);
}

TEST(Trainer, ACheckpointGoesOnWithTheSameFrozenTensorsAlone) {
  const Traversal city = small_city();
  TrainerOptions free = small("features"), frozen = free;
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
  TrainerOptions options = small("features");
  options.network_parameters["cells"] = 8;
  TrainerOptions wider = small("features");
  wider.initial = Trainer(options, task_of(city)).agent();
  EXPECT_TRUE(contains(refusal(wider, city), "tensor 'lstm.input' is 32 x"));
  wider.initial = Trainer(small("baseline"), task_of(city)).agent();
  EXPECT_TRUE(contains(refusal(wider, city), "is a 'baseline', the one to train a 'features'"));
  wider.initial = Trainer(small("features"), task_of(city)).agent();
  wider.initial->parameters[5] = NAN;
  EXPECT_TRUE(contains(refusal(wider, city), "no numbers"));
}

TEST(Trainer, SaysWhyTensorsCannotBeFrozen) {
  const Traversal city = small_city();
  TrainerOptions options = small("features");
  options.frozen = {"lstm", "attention"};
  EXPECT_NE(refusal(options, city).find("'attention' (it has sensors.weight, sensors.bias, lstm.input"),
            std::string::npos)
      << refusal(options, city);
  options.frozen = {"sensors", "lstm", "heads", "auxiliary"};
  EXPECT_TRUE(contains(refusal(options, city), "nothing is left to learn"));
}

TEST(Trainer, KeepsItsMapInCheckpoints) {
  const Traversal map = crossed(small_city());
  Loop loop(map, small("place_filter"));
  loop.update();
  const std::string path = std::filesystem::path(::testing::TempDir()) / "map.clk";
  const Checkpoint checkpoint = loop.trainer.checkpoint();
  write_checkpoint(path, checkpoint);
  const TrainedAgent agent = trained_agent(read_checkpoint(path));
  EXPECT_EQ(agent.task.turns, map.turns);
  EXPECT_EQ(agent.parameters, loop.trainer.agent().parameters);
  Loop again(map, small("place_filter"));
  again.trainer.load(read_checkpoint(path));
  loop.update();
  again.update();
  EXPECT_EQ(again.trainer.agent().parameters, loop.trainer.agent().parameters);

  Loop on_a_line(small_city(), small("features")), on_the_map(map, small("features"));
  EXPECT_FALSE(on_a_line.trainer.checkpoint().header.contains("turns"));
  EXPECT_THROW(on_a_line.trainer.load(on_the_map.trainer.checkpoint()), Error);
  EXPECT_THROW(on_the_map.trainer.load(on_a_line.trainer.checkpoint()), Error);
}

TEST(Trainer, RefusesWhatCannotLearnAMap) {
  const Traversal map = crossed(small_city());
  TrainerOptions options = small("place_filter");
  options.curriculum = true;
  EXPECT_THROW(Trainer(options, task_of(map)), Error);
  options = small("place_filter");
  options.learner = "relabel";
  options.learner_parameters.clear();
  EXPECT_NO_THROW(Trainer(options, task_of(small_city())));
  EXPECT_THROW(Trainer(options, task_of(map)), Error);
  for (const std::string agent : {"place_filter", "features"}) {
    NetworkTask bad = task_of(map);
    bad.turns.back() = 0;
    EXPECT_THROW(Trainer(small(agent), bad), Error) << agent;
  }
}

TEST(Trainer, SaysWhatIsWrong) {
  const Traversal city = small_city();
  TrainerOptions options = small("baseline");
  options.trainer_parameters["sequence"] = 7;
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  options = small("baseline");
  options.learner_parameters["speed"] = 7;
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  options = small("nobody");
  EXPECT_THROW(Trainer(options, task_of(city)), Error);
  EXPECT_THROW(Trainer(small("place_filter"), NetworkTask{12, 16, {}}), Error);

  Trainer trainer(small("baseline"), task_of(city));
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

/// Keeps what it is given.
class Recorder : public Learner {
 public:
  explicit Recorder(const LearnerTask& task) {
    Random random{3};
    task.network.initialise(random, parameters_);
  }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    last = *rollouts[0];
    return {};
  }
  const Vector<float>& parameters() const override { return parameters_; }
  void save(LearnerState&) const override {}
  void load(const LearnerState&) override {}
  static inline Rollout last;

 private:
  Vector<float> parameters_;
};
const LearnerRegistry::Registration recorder{
    {"recorder", "for tests", {}, [](const Parameters&, const LearnerTask& task) {
       return std::make_unique<Recorder>(task);
     }}};

/// The rollout says what the environment did, and values a truncated episode as if it had gone on.
TEST(Trainer, RefusesALearnerThatCannotBeginOrFreeze) {
  const Traversal city = small_city();
  TrainerOptions options = small("baseline");
  options.learner = "recorder";
  options.learner_parameters.clear();
  options.frozen = {"lstm"};
  EXPECT_TRUE(contains(refusal(options, city), "learner 'recorder' cannot keep tensors as they are"));
  options.frozen.clear();
  options.initial = Trainer(small("baseline", 7), task_of(city)).agent();
  EXPECT_TRUE(contains(refusal(options, city), "learner 'recorder' cannot start from given parameters"));
}

TEST(Trainer, CollectsWhatHappened) {
  const Traversal city = small_city();
  TrainerOptions options = small("features");
  options.learner = "recorder";
  options.learner_parameters.clear();
  options.max_steps = 6;
  options.trainer_parameters["noise-frame"] = options.trainer_parameters["noise-episode"] = 0;
  Loop loop(city, options);
  loop.update();
  loop.update();  // the second segment begins in the midst of episodes
  const Rollout& r = Recorder::last;
  const TrainedAgent agent = loop.trainer.agent();
  const auto workspace = agent.network->make_workspace();
  int terminated = 0, truncated = 0;
  for (int a = 0; a < 4; ++a) {
    Matrix<float> state = r.states.col(a);
    for (int t = 0; t < 24; ++t) {
      const std::size_t i = static_cast<std::size_t>(t * 4 + a), next = i + 4;
      NetworkInputs<float> one;
      one.resize(city.dimension, 1, 1);
      one.frames = city.frames;
      one.copy_column(r.inputs, t * 4 + a, 0);
      if (t == 12) {
        EXPECT_TRUE(r.states.col(4 + a).isApprox(state, 1e-5f));
      }
      agent.network->forward(agent.parameters, one, state, *workspace);
      EXPECT_NEAR(workspace->heads.values(0), r.value[i], 1e-5);
      state = workspace->state;
      if (t == 23) break;
      const bool ended = r.ended[i] != Rollout::kGoesOn;
      EXPECT_EQ(r.inputs.first[next] != 0, ended);
      EXPECT_EQ(r.inputs.previous_action[next], ended ? std::uint8_t{kNoAction} : r.action[i]);
      const int moved = r.action[i] == kNext ? 1 : r.action[i] == kPrevious ? -1 : 0;
      EXPECT_EQ(r.inputs.position[next], r.inputs.position[i] + moved);
      if (r.ended[i] == Rollout::kTerminated) {
        ++terminated;
        EXPECT_EQ(r.inputs.position[next], r.inputs.goal[i]);
        EXPECT_EQ(r.reward[i], 1.0f);
      } else {
        EXPECT_LE(r.reward[i], 0.0f);
      }
      if (r.ended[i] != Rollout::kTruncated) continue;
      ++truncated;
      one.copy_column(r.inputs, t * 4 + a + 4, 0);
      one.goal[0] = r.inputs.goal[i];
      one.previous_action[0] = r.action[i];
      one.first[0] = 0;
      agent.network->forward(agent.parameters, one, state, *workspace);
      EXPECT_NEAR(workspace->heads.values(0), r.final_value[i], 1e-5);
    }
  }
  EXPECT_GT(terminated, 0);
  EXPECT_GT(truncated, 0);
}

/// Seen again in the same episode a place looks the same, whichever noise it is that stays.
TEST(Trainer, DisguisesFramesTheSameWayAllThroughAnEpisode) {
  for (const std::string noise : {"noise-place", "noise-episode"}) {
    SCOPED_TRACE(noise);
    const Traversal city = small_city();
    TrainerOptions options = small("features");
    options.learner = "recorder";
    options.learner_parameters.clear();
    options.trainer_parameters["noise-frame"] = options.trainer_parameters["noise-episode"] = 0;
    options.trainer_parameters[noise] = 2;
    Loop loop(city, options);
    loop.update();
    const Rollout& r = Recorder::last;
    // What was added, seen from the frame as it is.
    const auto added = [&](int column) -> Vector<float> {
      const std::span<const float> plain = city.feature(r.inputs.position[static_cast<std::size_t>(column)]);
      const Eigen::Map<const Vector<float>> frame(plain.data(), static_cast<std::ptrdiff_t>(plain.size()));
      return r.inputs.features_of(column) / r.inputs.features_of(column).dot(frame) - frame / frame.squaredNorm();
    };
    bool differs = false, places_differ = false;
    for (int column = 0; column < 96; ++column) {
      EXPECT_NEAR(r.inputs.features_of(column).norm(), 1, 1e-5);
      for (int earlier = column % 4; earlier < column; earlier += 4) {
        const auto c = static_cast<std::size_t>(column), e = static_cast<std::size_t>(earlier);
        bool same_episode = true;
        for (int between = earlier + 4; between <= column; between += 4)
          same_episode &= !r.inputs.first[static_cast<std::size_t>(between)];
        if (r.inputs.position[c] != r.inputs.position[e]) {
          const Vector<float> one = added(column).normalized(), other = added(earlier).normalized();
          places_differ |= same_episode && std::abs(one.dot(other)) < 0.5f;
          continue;
        }
        const bool alike = r.inputs.features_of(column).isApprox(r.inputs.features_of(earlier), 1e-5f);
        if (same_episode) {
          EXPECT_TRUE(alike);
        }
        differs |= !alike;
      }
    }
    EXPECT_TRUE(differs);
    EXPECT_EQ(places_differ, noise == "noise-place");
  }
}

TEST(Trainer, GoesThroughTheLessons) {
  const Traversal city = small_city();
  TrainerOptions options = small("baseline");
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

double spl(const TrainedAgent& agent, const Traversal& city, bool greedy) {
  Environment environment(city, 50);
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.frames() = static_cast<std::uint32_t>(city.frames);
  settings.max_steps() = static_cast<std::uint32_t>(city.frames);
  settings.tasks() = 200;
  environment.reset(settings);
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

/// The observation without some of its agents.
msg::Observation without(const msg::Observation& all, const std::set<std::size_t>& idle) {
  msg::Observation some = all;
  const auto drop = [&](auto& values) {
    std::size_t index = 0;
    const std::size_t share = values.size() / all.goal().size();
    std::erase_if(values, [&](auto) { return idle.contains(index++ / share); });
  };
  drop(some.frame());
  drop(some.position());
  drop(some.goal());
  drop(some.previous_action());
  drop(some.allowed());
  drop(some.flags());
  drop(some.reward());
  drop(some.features());
  return some;
}

/// Those whose tasks are done disturb nobody.
TEST_P(EachNetwork, ActsAsIfIdleAgentsWereNotThere) {
  const Traversal city = small_city_for(GetParam());
  TrainerOptions options = small(GetParam());
  Loop loop(city, options, 1, 6);
  loop.update();
  const TrainedAgent agent = loop.trainer.agent();
  Environment environment(city, 6);
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.frames() = settings.max_steps() = static_cast<std::uint32_t>(city.frames);
  settings.tasks() = 600;
  environment.reset(settings);
  const std::set<std::size_t> idle = {0, 3, 4};
  NetworkPolicy everybody(agent, {.seed = 5, .greedy = false}), few(agent, {.seed = 5, .greedy = false});
  msg::Observation observation;
  std::vector<std::uint8_t> choice, expected;
  for (int step = 0; step < 12; ++step) {
    environment.observe(observation);
    msg::Observation marked = observation;
    for (const std::size_t agent_index : idle) marked.flags()[agent_index] |= msg::FLAG_IDLE;
    everybody.act(marked, choice);
    ASSERT_EQ(choice.size(), 6u);
    few.act(without(observation, idle), expected);
    std::size_t column = 0;
    for (std::size_t index = 0; index < 6; ++index) {
      if (idle.contains(index)) {
        EXPECT_EQ(choice[index], 0);
      } else {
        EXPECT_EQ(choice[index], expected[column++]) << "step " << step;
      }
    }
    environment.step(choice);  // who is idle stays
  }
  for (std::uint8_t& flags : observation.flags()) flags = msg::FLAG_IDLE;
  everybody.act(observation, choice);
  EXPECT_EQ(choice, std::vector<std::uint8_t>(6));
}

/// Each network learns the small city, looking at it, within its budget of steps. (A blind sweep has SPL 0.85 or less.)
TEST_P(EachNetwork, LearnsTheSmallCity) {
  const Traversal city = small_city_for(GetParam());
  TrainerOptions options = small(GetParam());
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

/// Best SPL of who never turns, over all starts and goals.
double spl_without_turning(const Traversal& city) {
  double sum = 0;
  std::vector<int> distances;
  for (int goal = 0; goal < city.frames; ++goal) {
    distances_to(goal, city.frames, city.turns, distances);
    for (int start = 0; start < city.frames; ++start)
      if (start != goal)
        sum += static_cast<double>(distances[static_cast<std::size_t>(start)]) / std::abs(goal - start);
  }
  return sum / (city.frames * (city.frames - 1));
}

TEST(PlaceFilter, LearnsToTurnAtCrossings) {
  const Traversal city = crossed(small_city());
  ASSERT_LT(spl_without_turning(city), 0.85);
  TrainerOptions options = small("place_filter");
  options.learner_parameters = {{"learning-rate", 3e-3}, {"minibatch", 8}, {"gamma", 0.95}};
  options.trainer_parameters = {{"segment", 32},      {"sequence", 16},     {"steps", 80000},
                                {"noise-frame", 0.3}, {"noise-place", 0.3}, {"noise-episode", 0.3}};
  Loop loop(city, options, 1, 16);
  while (!loop.trainer.done()) loop.update();
  EXPECT_GT(spl(loop.trainer.agent(), city, false), 0.95);
  EXPECT_GT(spl(loop.trainer.agent(), city, true), 0.95);
}

}  // namespace
}  // namespace citylearn::testing
