// SPDX-License-Identifier: Apache-2.0
// Beliefs and controls on the made map of tests/support/streets.h; values by hand.
#include <gtest/gtest.h>

#include "env_service/environment.h"
#include "policy_service/network/street_votes.h"
#include "policy_service/rollout/belief.h"
#include "policy_service/rollout/control.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr std::uint8_t kNone = kNoAction, kTurns = 0b111, kAheadOnly = 1u << kForward;

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
Walked walk(const std::string& name, const Traversal& traversal, float radius = 0, double slip = 0) {
  Imperfections imperfections;
  imperfections.slip = slip;
  Environment environment(traversal, 5, imperfections);
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

TEST(StreetControls, KnowWhereTheShortestWayBegins) {
  const auto map = small_states();
  DistanceFields fields(*map);
  std::vector<std::uint8_t> ways;
  for (int state = 0; state < map->states(); ++state) ways.push_back(way_to(fields.to(0), *map, state));
  EXPECT_EQ(ways, (std::vector<std::uint8_t>{kNone, kNone, kLeft, kForward, kLeft, kRight, kForward, kForward, kForward,
                                             kForward, kLeft, kLeft, kForward}));
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

TEST(StreetControls, BlindGoesToTheNearestPlaceWhereItHasNotBeen) {
  const auto blind = street_control("blind", streets_traversal());
  const auto map = small_states();
  msg::Observation seen;
  seen.flags() = {msg::FLAG_FIRST};
  seen.position() = seen.goal() = seen.frame() = {0};
  seen.previous_action() = {kNone};
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

TEST(StreetFilter, MovesByTheMapAndExcludesByWhatIsAllowed) {
  const Traversal traversal = streets_traversal();
  const PlaceKeys<float> keys(Eigen::Map<const Matrix<float>>(traversal.features.data(), 16, 13), 16, 13, true);
  SparseFilter<float> filter(keys, Motion<float>(0.2, 0), small_states());
  const Matrix<float> features = Matrix<float>::Zero(16, 1);
  SparseStep<float> step;
  // What is seen is no evidence. Only states 7 and 8 allow no turn, and 8 is at the goal.
  step.goal = 4;
  step.allowed = kAheadOnly;
  step.first = step.repeated = true;
  filter.advance(features, 13, 16, 0, {&step, 1});
  ASSERT_EQ(step.after.places, std::vector<int>{7});
  EXPECT_FLOAT_EQ(step.after.shares[0], 1);
  const SparseBelief<float> before = step.after;
  step = {};
  step.before = &before;
  step.goal = 4;
  step.action = kForward;
  step.allowed = kTurns;
  step.repeated = true;
  filter.advance(features, 13, 16, 0, {&step, 1});
  // .8 in state 12, .1 in 9, twice as far; .1 stayed in 7, where a turn is not allowed.
  ASSERT_EQ(step.after.places, (std::vector<int>{12, 9}));
  EXPECT_NEAR(step.after.shares[0], 8 / 9., 1e-6);
  EXPECT_NEAR(step.after.shares[1], 1 / 9., 1e-6);
  // The way to place 2 is straight on from both: 12, 9, 0, 2, 5.
  const auto share = votes(step, DistanceFields(*small_states()).to(2), *small_states());
  EXPECT_NEAR(share[kForward], 1, 1e-6);
}

TEST(StreetFilter, IsLostByWhatIsMoreThanAStepAway) {
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
