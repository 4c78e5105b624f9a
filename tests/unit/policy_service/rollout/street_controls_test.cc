// SPDX-License-Identifier: Apache-2.0
// Beliefs and controls on the made map of tests/support/streets.h; values by hand.
#include <gtest/gtest.h>

#include "env_service/environment.h"
#include "policy_service/rollout/belief.h"
#include "policy_service/rollout/control.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

std::unique_ptr<Policy> street_control(const std::string& name, const Traversal& traversal, float radius = 0) {
  ControlTask task{0, traversal.frames,
                   Eigen::Map<const Matrix<float>>(traversal.features.data(), traversal.dimension, traversal.frames)};
  task.streets = std::make_shared<const StateMap>(*traversal.streets, traversal.rule, msg::MAX_FRAMES);
  task.goal_radius = radius;
  const auto& entry = ControlRegistry::instance().find("control", name);
  return entry.create(Parameters(name, entry.parameters, {}), task);
}

struct Walked {
  double spl = 0, completed = 0;
};

/// Evaluates a control on 40 tasks, each of at most 3 times its fewest steps.
Walked walk(const std::string& name, const Traversal& traversal, float radius = 0, double slip = 0, int goals = 1) {
  Imperfections imperfections;
  imperfections.slip = slip;
  Environment environment(traversal, 5, imperfections, goals);
  msg::TaskSettings with = settings(msg::EVALUATE, static_cast<std::uint32_t>(traversal.frames), 1000);
  with.tasks() = 40;
  with.max_detour() = 3;
  with.goal_radius() = radius;
  environment.reset(with);
  const auto policy = street_control(name, traversal, radius);
  policy->begin(0, {});
  msg::Observation seen;
  std::vector<std::uint8_t> choice;
  Walked walked;
  while (!environment.done()) {
    environment.observe(seen);
    policy->act(seen, choice);
    environment.step(choice);
    for (const auto& episode : environment.finished()) {
      walked.completed += episode.completed / 40.0;
      walked.spl += episode.completed ? episode.shortest / 40.0 / episode.steps : 0;
    }
  }
  return walked;
}

TEST(StreetControls, WalkTheFewestStepsWhereTheyKnowTheirState) {
  for (const StateRule rule : {StateRule::kStreet, StateRule::kStreetFixed, StateRule::kStreetLearn}) {
    const Traversal traversal = streets_traversal(small_streets(), rule);
    const Walked best = walk("shortest_path", traversal), seeing = walk("sequence_filter", traversal),
                 blind = walk("blind", traversal);
    EXPECT_NEAR(best.spl, 1, 1e-9);
    EXPECT_NEAR(seeing.spl, 1, 1e-9) << "all views differ";
    EXPECT_LT(blind.spl, 0.95);
    EXPECT_GT(blind.spl, 0.1);
    EXPECT_NEAR(walk("shortest_path", traversal, 10).spl, 1, 1e-9) << "goals have a radius";
  }
  const Walked slipping = walk("sequence_filter", streets_traversal(), 0, 0.2);
  EXPECT_GT(slipping.completed, 0.6);
  EXPECT_LT(slipping.spl, 1);
}

TEST(StreetControls, WalkThroughSeveralGoals) {
  for (const StateRule rule : {StateRule::kStreet, StateRule::kStreetFixed, StateRule::kStreetLearn})
    for (const float radius : {0.0f, 10.0f}) {
      const Traversal traversal = streets_traversal(small_streets(), rule);
      const auto courier = [&](const char* name) { return walk(name, traversal, radius, 0, 3); };
      // These two know which goal is next, and so with which heading to arrive.
      EXPECT_NEAR(courier("shortest_path").spl, 1, 1e-9);
      EXPECT_NEAR(courier("oracle_filter").spl, 1, 1e-9);
      const Walked seeing = courier("sequence_filter");
      EXPECT_NEAR(seeing.completed, 1, 1e-9);
      EXPECT_GT(seeing.spl, 0.9);
      EXPECT_LT(courier("blind").spl, seeing.spl - 0.1);
    }
}

TEST(StreetControls, BlindGoesToTheNearestPlaceWhereItHasNotBeen) {
  const auto blind = street_control("blind", streets_traversal());
  const auto map = small_states();
  msg::Observation seen;
  seen.flags() = {msg::FLAG_FIRST};
  seen.position() = seen.goal() = seen.frame() = {0};
  seen.previous_action() = {+kNoAction};
  std::vector<std::uint8_t> choice, walked;
  for (int state = 0, step = 0; step < 9; ++step) {
    seen.allowed() = {map->allowed(state)};
    blind->act(seen, choice);
    walked.push_back(choice.at(0));
    state = map->next(state, choice[0]);
    ASSERT_GE(state, 0);
    seen.flags() = {0};
    seen.previous_action() = choice;
  }
  // Once around, then to the dead end.
  EXPECT_EQ(walked, (std::vector<std::uint8_t>{1, 1, 1, 1, 1, 1, 1, 1, kLeft}));
}

TEST(StreetBelief, IsLostByWhatIsMoreThanAStepAway) {
  const auto map = small_states();
  // Beside state 5: to 7, 4 and 6; from 2, 4, 6 and 8.
  Vector<float> scores = Vector<float>::Constant(13, -1e5f);
  const std::vector<std::pair<int, double>> shares{{5, 0.5}, {7, 0.125}, {8, 0.125}, {2, 0.125}, {3, 0.125}};
  for (const auto& [state, share] : shares) scores(state) = static_cast<float>(std::log(share));
  msg::Belief belief;
  add_belief(scores, 0, belief, map.get());
  EXPECT_EQ(belief.likely()[0], 5u);
  EXPECT_NEAR(belief.lost()[0], 0.125, 1e-6) << "state 3 is two steps away";
}

}  // namespace
}  // namespace citylearn::testing
