// SPDX-License-Identifier: Apache-2.0
// The rollouts that a trainer hands to its learner.
#include <gtest/gtest.h>

#include <cmath>

#include "policy_service/learning/trainer.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

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
const LearnerRegistry::Registration recorder_registration{
    {"recorder", "for tests", {}, [](const Parameters&, const LearnerTask& task) {
       return std::make_unique<Recorder>(task);
     }}};

/// Options of a training of `agent` whose rollouts Recorder::last shows.
TrainerOptions recorded(const std::string& agent) {
  TrainerOptions options = small_options(agent);
  options.learner = "recorder";
  options.learner_parameters.clear();
  return options;
}

TEST(Trainer, RefusesALearnerThatCannotBeginOrFreeze) {
  const Traversal city = small_city();
  TrainerOptions options = recorded("baseline");
  options.frozen = {"lstm"};
  EXPECT_TRUE(contains(error_of([&] { Trainer(options, task_of(city)); }),
                       "learner 'recorder' cannot keep tensors as they are"));
  options.frozen.clear();
  options.initial = Trainer(small_options("baseline", 7), task_of(city)).agent();
  EXPECT_TRUE(contains(error_of([&] { Trainer(options, task_of(city)); }),
                       "learner 'recorder' cannot start from given parameters"));
}

/// A hundredth, added a hundred times, is more than 1.
TEST(Trainer, TheMeanSplOfPerfectEpisodesIsOne) {
  const Traversal city = small_city();
  Trainer trainer(recorded("baseline"), task_of(city));
  Rollout none;
  Rollout* const rollouts[] = {&none};
  trainer.learn(rollouts, std::vector<FinishedEpisode>(100, {.tick = 1, .reward = 1, .spl = 1, .steps = 4}));
  EXPECT_EQ(trainer.progress().spl, 1);
}

/// The rollout says what the environment did, and values a truncated episode as if it had gone on.
TEST(Trainer, CollectsWhatHappened) {
  const Traversal city = small_city();
  TrainerOptions options = recorded("features");
  options.max_steps = 6;
  for (const char* noise : {"noise-frame", "noise-place", "noise-episode"}) options.trainer_parameters[noise] = 0;
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

TEST(Trainer, TellsTheLearnerWhatAStepCosts) {
  const Traversal city = small_city();
  TrainerOptions options = recorded("features");
  options.trainer_parameters["step-cost"] = 0.25;
  Loop loop(city, options);
  loop.update();
  std::set<float> rewards(Recorder::last.reward.begin(), Recorder::last.reward.end());
  rewards.erase(1.0f);
  EXPECT_EQ(rewards, (std::set<float>{-0.25f, 0.0f}));
  EXPECT_GT(loop.trainer.progress().reward, -2) << "episodes are reported as the environment rewards them";
}

/// Seen again in the same episode a place looks the same, whichever noise it is that stays.
TEST(Trainer, DisguisesFramesTheSameWayAllThroughAnEpisode) {
  for (const std::string kind : {"noise-place", "noise-episode"}) {
    SCOPED_TRACE(kind);
    const Traversal city = small_city();
    TrainerOptions options = recorded("features");
    for (const char* noise : {"noise-frame", "noise-place", "noise-episode"}) options.trainer_parameters[noise] = 0;
    options.trainer_parameters[kind] = 2;
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
    EXPECT_EQ(places_differ, kind == "noise-place");
  }
}

}  // namespace
}  // namespace citylearn::testing
