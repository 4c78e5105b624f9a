// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/belief/sparse_filter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "core/task/state_map.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/network/belief/street_votes.h"
#include "policy_service/rollout/control.h"
#include "tests/support/env/env.h"
#include "tests/support/env/streets_traversal.h"
#include "tests/support/networks/small_networks.h"

namespace citylearn::testing {
namespace {

constexpr int kNever = 1 << 30;

/// A route whose neighbouring places look alike.
template <class S>
struct Route {
  explicit Route(int frames, int features) {
    task.features = features;
    task.frames = frames;
    task.reference = route_features(features, frames, random);
  }
  std::unique_ptr<AgentNetwork<S>> network(int sparse_from, const std::map<std::string, double>& parameters) const {
    NetworkTask what = task;
    what.sparse_from = sparse_from;
    const auto& entry = NetworkRegistry<S>::instance().find("network", "place_filter");
    return entry.create(Parameters(entry.name, entry.parameters, parameters), what);
  }
  /// Lets an agent at `position` see its place, with noise.
  void show(NetworkInputs<S>& inputs, int column, int position, int goal, std::uint8_t action, bool first,
            double noise) {
    const auto index = static_cast<std::size_t>(column);
    Vector<S> seen = task.reference.col(position).cast<S>();
    for (S& value : seen) value += static_cast<S>(noise * random.normal() / std::sqrt(task.features));
    inputs.see(column, -1, seen.normalized());
    inputs.position[index] = position;
    inputs.goal[index] = goal;
    inputs.previous_action[index] = action;
    inputs.first[index] = first;
    inputs.allowed[index] = position == 0 ? 0b011 : position == task.frames - 1 ? 0b101 : 0b111;
  }

  NetworkTask task;
  Random random{7};
};

struct Agreement {
  double worst = 0, mean = 0;               ///< difference of an action's probabilities before any kidnapping
  int dense_astray = 0, sparse_astray = 0;  ///< steps at which the likeliest place is not next to the agent's
  int episodes = 0;
};

/// Walks 8 agents for 1,000 steps each, as the dense filter says. Goals are near or far; the ends are walked to.
Agreement compare(const std::map<std::string, double>& told, double slips, double kidnaps, double noise) {
  constexpr int kWalkers = 8, kRoutePlaces = 2500;
  Route<float> route(kRoutePlaces, 64);
  Random& random = route.random;
  const auto dense = route.network(kNever, told), sparse = route.network(0, told);
  Vector<float> parameters;
  dense->initialise(random, parameters);
  for (float& value : parameters) value += 0.02f * static_cast<float>(random.normal());
  const auto dense_work = dense->make_workspace(), sparse_work = sparse->make_workspace();
  dense_work->state = Matrix<float>::Zero(dense->state_size(), kWalkers);
  sparse_work->state = Matrix<float>::Zero(sparse->state_size(), kWalkers);
  struct Agent {
    int position = 0, goal = 0, age = 0;
    bool kidnapped = false;
    std::uint8_t action = static_cast<std::uint8_t>(kNoAction);
  };
  std::vector<Agent> agents(kWalkers);
  Agreement result;
  const auto place = [&] { return static_cast<int>(random.below(kRoutePlaces)); };
  const auto begin = [&] {
    ++result.episodes;
    Agent agent;
    agent.position = random.below(8) == 0 ? static_cast<int>(random.below(5)) : place();
    do
      agent.goal = random.below(2)
                       ? place()
                       : std::clamp(agent.position + static_cast<int>(random.below(41)) - 20, 0, kRoutePlaces - 1);
    while (agent.goal == agent.position);
    return agent;
  };
  for (Agent& agent : agents) agent = begin();
  int compared = 0;
  NetworkInputs<float> inputs;
  for (int step = 0; step < 1000; ++step) {
    inputs.resize(64, 1, kWalkers);
    inputs.frames = kRoutePlaces;
    for (int a = 0; a < kWalkers; ++a) {
      const Agent& agent = agents[static_cast<std::size_t>(a)];
      route.show(inputs, a, agent.position, agent.goal, agent.action, agent.age == 0, noise);
    }
    const Matrix<float> dense_before = dense_work->state, sparse_before = sparse_work->state;
    dense->forward(parameters, inputs, dense_before, *dense_work);
    sparse->forward(parameters, inputs, sparse_before, *sparse_work);
    for (int a = 0; a < kWalkers; ++a) {
      Agent& agent = agents[static_cast<std::size_t>(a)];
      const auto policy = [&](const Workspace<float>& of) {
        const Eigen::Array3d logits = of.heads.logits.col(a).cast<double>().array();
        const Eigen::Array3d odds = (logits - logits.maxCoeff()).exp();
        return Eigen::Array3d(odds / odds.sum());
      };
      const auto astray = [&](const AgentNetwork<float>& network, const Workspace<float>& of) {
        std::ptrdiff_t likeliest = 0;
        network.belief(of.state.col(a)).maxCoeff(&likeliest);
        return std::abs(likeliest - agent.position) > 1;
      };
      result.dense_astray += astray(*dense, *dense_work);
      result.sparse_astray += astray(*sparse, *sparse_work);
      const Eigen::Array3d wanted = policy(*dense_work);
      if (!agent.kidnapped) {
        const double difference = (wanted - policy(*sparse_work)).abs().maxCoeff();
        result.worst = std::max(result.worst, difference);
        result.mean += difference;
        ++compared;
      }
      const double draw = random.uniform();
      agent.action = draw < wanted(0) ? kStay : draw < wanted(0) + wanted(1) ? kNext : kPrevious;
      if (!(inputs.allowed[static_cast<std::size_t>(a)] >> agent.action & 1)) agent.action = kStay;
      const int times = random.uniform() < slips ? 2 * static_cast<int>(random.below(2)) : 1;
      agent.position = StateMap(kRoutePlaces).after(agent.position, agent.action, times);
      if (random.uniform() < kidnaps) {
        agent.position = place();
        agent.kidnapped = true;
      }
      if (agent.position == agent.goal || ++agent.age > 120) agent = begin();
    }
  }
  result.mean /= compared;
  return result;
}

TEST(SparseFilter, ActsAsTheDenseFilter) {
  const Agreement exact = compare({{"slip", 0}}, 0, 0, 1), learned = compare({}, 0, 0, 1),
                  noisy = compare({}, 0.1, 0, 2), told = compare({{"slip", 0.1}, {"kidnap", 0.01}}, 0.1, 0, 2);
  for (const Agreement& one : {exact, learned}) {
    EXPECT_GE(one.episodes, 100);
    EXPECT_LE(one.worst, 1e-3);
    EXPECT_LE(one.mean, 1e-6);
  }
  for (const Agreement& one : {noisy, told}) {
    EXPECT_LE(one.worst, 0.05);
    EXPECT_LE(one.mean, 1e-4);
    EXPECT_LE(one.sparse_astray, 1.05 * one.dense_astray + 10);
  }
}

/// A kidnapped agent has to be found again, as soon as the dense filter finds it. One that reckons with kidnappings
/// takes two steps more: at the first the dense filter knows the place, and the sparse one looks at all once it doubts.
TEST(SparseFilter, LooksAtAllPlacesAgainWhenItIsLost) {
  for (const std::map<std::string, double>& told :
       {std::map<std::string, double>{}, {{"slip", 0.1}, {"kidnap", 0.01}}}) {
    const Agreement one = compare(told, 0.1, 0.01, 1);
    EXPECT_GT(one.dense_astray, 50) << "there were kidnappings";
    EXPECT_LE(one.sparse_astray, one.dense_astray + (told.empty() ? 0 : 2 * 80));  // 80 kidnappings in 8,000 steps
    EXPECT_LE(one.worst, 0.03);
  }
}

/// The gradient reaches g, u and d through the active places, and through what is elsewhere.
TEST(SparseFilter, DifferentiatesWhatItComputes) {
  constexpr int kWalkSteps = 6, kWalkers = 3;
  for (const double kidnap : {0.0, 0.1}) {
    Route<double> route(60, 8);
    const auto network = route.network(0, {{"units", 5}, {"slip", 2 * kidnap}, {"kidnap", kidnap}});
    Vector<double> parameters;
    network->initialise(route.random, parameters);
    for (double& value : parameters) value += 0.1 * route.random.normal();
    NetworkInputs<double> inputs;
    inputs.resize(8, kWalkSteps, kWalkers);
    inputs.frames = 60;
    for (int t = 0; t < kWalkSteps; ++t)
      for (int b = 0; b < kWalkers; ++b) {
        const bool first = (t == 0 && b < 2) || (t == 3 && b == 1);
        const int position = b == 2 && t < 2 ? 0 : 20 + 10 * b + t;
        route.show(inputs, t * kWalkers + b, position, 5 + 20 * b,
                   first ? std::uint8_t{kNoAction} : std::uint8_t{kNext}, first, 1);
      }
    SparseBelief<double> lost;  // agent 2 begins lost
    lost.places = {7, 8, 30};
    lost.shares = {0.5, 0.2, 0.1};
    lost.elsewhere = 0.2;
    lost.doubt = 2;
    Matrix<double> state = Matrix<double>::Zero(network->state_size(), kWalkers);
    lost.store(state.col(2));
    const auto workspace = network->make_workspace();
    network->forward(parameters, inputs, state, *workspace);
    Heads<double> weights = workspace->heads;
    for (std::ptrdiff_t i = 0; i < weights.logits.size(); ++i)
      weights.logits(i) = weights.logits(i) < -1e8 ? 0 : 1 + static_cast<double>(i % 7);
    for (std::ptrdiff_t i = 0; i < weights.values.size(); ++i) weights.values(i) = 1 + static_cast<double>(i % 5);
    Vector<double> gradient = Vector<double>::Zero(parameters.size());
    network->backward(parameters, inputs, *workspace, weights, gradient);
    EXPECT_GT(gradient.segment(2, 3).cwiseAbs().minCoeff(), 1e-9) << "all that is learned of filter.scalars matters";
    const auto sum = [&] {
      network->forward(parameters, inputs, state, *workspace);
      return workspace->heads.logits.cwiseProduct(weights.logits).sum() +
             workspace->heads.values.cwiseProduct(weights.values).sum();
    };
    for (std::ptrdiff_t i = 2; i < parameters.size(); ++i)
      ASSERT_NEAR(gradient(i), central_difference(parameters(i), sum), 1e-6 * gradient.cwiseAbs().maxCoeff()) << i;
  }
}

TEST(SparseFilter, HasAStateOfOneSizeAndBearsAnyNumbersInIt) {
  Route<float> route(2048, 8);
  const auto network = route.network(kSparsePlaces, {});
  EXPECT_EQ(network->state_size(), SparseBelief<float>::kStateSize);
  EXPECT_EQ(Route<float>(2047, 8).network(kSparsePlaces, {})->state_size(), 2049);
  Vector<float> parameters;
  network->initialise(route.random, parameters);
  NetworkInputs<float> inputs;
  const auto work = network->make_workspace();
  for (const float number : {-1.0f, 1e30f, 0.5f}) {
    inputs.resize(8, 1, 1);
    inputs.frames = 2048;
    route.show(inputs, 0, 1000, 3, kNext, false, 1);
    network->forward(parameters, inputs, Matrix<float>::Constant(network->state_size(), 1, number), *work);
    EXPECT_TRUE(work->heads.logits.allFinite() && work->state.allFinite());
    EXPECT_NEAR(network->belief(work->state.col(0)).array().exp().sum(), 1, 1e-3);
  }
}

/// An agent that has reached its goal knows where it is, whatever it believed and sees.
TEST(PlaceFilter, KnowsItsPlaceAtEachOfSeveralGoals) {
  Route<double> route(50, 8);
  for (const int sparse_from : {kNever, 0})
    for (const bool carried : {false, true}) {  // the arrival is the first step of a call, or its second
      const auto network = route.network(sparse_from, {{"slip", 0.1}});
      Vector<double> parameters;
      network->initialise(route.random, parameters);
      const auto work = network->make_workspace();
      Matrix<double> state = Matrix<double>::Zero(network->state_size(), 1);
      NetworkInputs<double> inputs;
      const auto begin = [&](int steps) {
        inputs.resize(8, steps, 1);
        inputs.frames = 50;
      };
      begin(carried ? 1 : 2);
      route.show(inputs, 0, 30, 20, kNoAction, true, 0);
      if (carried) {
        network->forward(parameters, inputs, state, *work);
        state = work->state;
        begin(1);
      }
      route.show(inputs, carried ? 0 : 1, 35, 10, kPrevious, false, 0);  // seen: another place than it is at
      network->forward(parameters, inputs, state, *work);
      Vector<double> belief = network->belief(work->state.col(0)).array().exp();
      belief /= belief.sum();
      EXPECT_NEAR(belief(20), 1, 1e-6) << sparse_from << carried;
    }
}

/// Follows an agent on the small streets that sees nothing, forward from what it believed before, or at its first step.
SparseStep<float> step_on_streets(float slip, int goal, std::uint8_t allowed, const SparseBelief<float>* before) {
  const Traversal traversal = streets_traversal();
  const PlaceKeys<float> keys(Eigen::Map<const Matrix<float>>(traversal.features.data(), 16, 13), 16, 13, true);
  SparseStep<float> step;
  step.before = before;
  step.goal = goal;
  step.allowed = allowed;
  step.first = !before;
  step.repeated = true;
  if (before) step.action = kForward;
  SparseFilter<float>(keys, Motion<float>(slip, 0), small_states())
      .advance(Matrix<float>::Zero(16, 1), 13, 16, 0, {&step, 1});
  return step;
}

/// On streets it is known with which heading one came, if that was believed.
TEST(SparseFilter, OnStreetsKnowsItsPlaceAtEachOfSeveralGoals) {
  SparseBelief<float> before;
  before.places = {2, 7};  // at place 1 facing 2, or at 3
  before.shares = {0.25f, 0.75f};
  before.elsewhere = 0;
  before.goal = 2;
  SparseStep<float> step = step_on_streets(0, 0, 0b111, &before);
  EXPECT_EQ(step.after.places, std::vector<int>{5}) << "forward from 2";
  EXPECT_EQ(step.after.goal, 0);
  before.places = {7};  // which leads elsewhere
  before.shares = {1};
  step = step_on_streets(0, 0, 0b111, &before);
  EXPECT_EQ(step.after.places, (std::vector<int>{4, 5, 6})) << "any heading at place 2";
  for (const float share : step.after.shares) EXPECT_FLOAT_EQ(share, 1 / 3.0f);
}

TEST(StreetVotes, KnowWhereTheShortestWayBegins) {
  const auto map = small_states();
  DistanceFields fields(*map);
  std::vector<std::uint8_t> ways;
  for (int state = 0; state < map->states(); ++state) ways.push_back(way_to(fields.to(0), *map, state));
  EXPECT_EQ(ways, (std::vector<std::uint8_t>{kNoAction, kNoAction, kLeft, kForward, kLeft, kRight, kForward, kForward,
                                             kForward, kForward, kLeft, kLeft, kForward}));
}

TEST(SparseFilter, OnStreetsMovesByTheMapAndExcludesByWhatIsAllowed) {
  // Only states 7 and 8 allow no turn, and 8 is at the goal.
  SparseStep<float> step = step_on_streets(0.2f, 4, 1u << kForward, nullptr);
  ASSERT_EQ(step.after.places, std::vector<int>{7});
  EXPECT_FLOAT_EQ(step.after.shares[0], 1);
  const SparseBelief<float> before = step.after;
  step = step_on_streets(0.2f, 4, 0b111, &before);
  // .8 in state 12, .1 in 9, twice as far; .1 stayed in 7, where a turn is not allowed.
  ASSERT_EQ(step.after.places, (std::vector<int>{12, 9}));
  EXPECT_NEAR(step.after.shares[0], 8 / 9., 1e-6);
  EXPECT_NEAR(step.after.shares[1], 1 / 9., 1e-6);
  // The way to place 2 is straight on from both: 12, 9, 0, 2, 5.
  const auto share = votes(step, DistanceFields(*small_states()).to(2), *small_states());
  EXPECT_NEAR(share[kForward], 1, 1e-6);
}

TEST(Votes, AreForEachActionThatLeadsNearer) {
  SparseStep<float> step;
  step.places = {3, 0};  // 1 to the west, where either turn is a way to place 2, and 0 to the east
  step.shares = {0.75f, 0.25f};
  const auto share = votes(step, DistanceFields(*small_states()).to(2), *small_states());
  EXPECT_EQ(share, (std::array<float, kActions>{0.75f, 0.25f, 0.75f}));
}

TEST(TurnGuard, LetsAnAgentFaceAllHeadingsThenGo) {
  for (const auto& [rule, most] : {std::pair{StateRule::kStreet, 4}, std::pair{StateRule::kStreetFixed, 15}}) {
    const TurnGuard guard(StateMap(small_streets(), rule, 1 << 20));
    int turns = TurnGuard::after(7, kNoAction);
    for (int i = 0; i < most; ++i) {
      EXPECT_FALSE(guard.must_go(turns, 0b111));
      turns = TurnGuard::after(turns, i % 2 ? kLeft : kRight);
    }
    EXPECT_TRUE(guard.must_go(turns, 0b111));
    EXPECT_FALSE(guard.must_go(turns, 0b101)) << "forward is not allowed";
    EXPECT_FALSE(guard.must_go(TurnGuard::after(turns, kForward), 0b111));
  }
}

TEST(SequenceFilter, WalksTheSameWaysWithASparseBelief) {
  constexpr int kRoutePlaces = 300, kWalkers = 4;
  const Traversal city = small_city(kRoutePlaces, 32);
  ControlTask task{0, kRoutePlaces, Eigen::Map<const Matrix<float>>(city.features.data(), 32, kRoutePlaces)};
  const auto& entry = ControlRegistry::instance().find("control", "sequence_filter");
  const Parameters parameters(entry.name, entry.parameters, {});
  const auto dense = entry.create(parameters, task);
  task.sparse_from = 0;
  const auto sparse = entry.create(parameters, task);
  Environment environment(city, kWalkers);
  environment.reset(settings(msg::TRAIN, kRoutePlaces, kRoutePlaces));
  msg::Observation seen;
  std::vector<std::uint8_t> choice, other;
  for (int step = 0; step < 400; ++step) {
    environment.observe(seen);
    dense->act(seen, choice);
    sparse->act(seen, other);
    ASSERT_EQ(choice, other) << "step " << step;
    environment.step(choice);
  }
  msg::Belief dense_belief, sparse_belief;
  dense->believe(dense_belief);
  sparse->believe(sparse_belief);
  for (std::size_t agent = 0; agent < kWalkers; ++agent)
    EXPECT_EQ(dense_belief.likely()[8 * agent], sparse_belief.likely()[8 * agent]);
}

}  // namespace
}  // namespace citylearn::testing
