// SPDX-License-Identifier: Apache-2.0
// What every learner promises (policy_service/learning/learner.h), asked of all that are registered in this program.
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <limits>
#include <memory>
#include <span>

#include "core/util/error.h"
#include "policy_service/learning/learner.h"
#include "tests/contract/random_rollout.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kPlaces = 12, kFeatures = 6;

std::vector<std::string> learners() {
  std::vector<std::string> names;
  for (const auto* entry : LearnerRegistry::instance().entries()) names.push_back(entry->name);
  return names;
}

bool same(const LearnerState& one, const LearnerState& other) {
  return one.counters == other.counters &&
         std::equal(one.tensors.begin(), one.tensors.end(), other.tensors.begin(), other.tensors.end(),
                    [](const auto& a, const auto& b) {
                      return a.first == b.first && a.second.size() == b.second.size() && a.second == b.second;
                    });
}

/// A network, and learners for it without a trainer.
class LearnerContract : public ::testing::TestWithParam<std::string> {
 protected:
  LearnerContract() {
    Random random{3};
    task_.features = kFeatures;
    task_.frames = kPlaces;
    task_.reference.resize(kFeatures, kPlaces);
    for (float& value : task_.reference.reshaped()) value = static_cast<float>(random.normal());
    network_ = network(8);
  }
  const LearnerRegistry::Entry& entry() const { return LearnerRegistry::instance().find("learner", GetParam()); }
  Parameters network_parameters(int cells) const {
    return Parameters("network", NetworkRegistry<float>::instance().find("network", "features").parameters,
                      {{"hidden", 16}, {"cells", static_cast<double>(cells)}});
  }
  std::unique_ptr<AgentNetwork<float>> network(int cells) const {
    return NetworkRegistry<float>::instance().find("network", "features").create(network_parameters(cells), task_);
  }
  std::unique_ptr<Learner> make(const AgentNetwork<float>& network, int cells, std::uint64_t seed,
                                const std::map<std::string, double>& given) const {
    return entry().create(Parameters("learner", entry().parameters, given),
                          LearnerTask{network, "features", network_parameters(cells), task_, workers_, seed, 10000});
  }
  std::unique_ptr<Learner> make(std::uint64_t seed, const std::map<std::string, double>& given = {}) const {
    return make(*network_, 8, seed, given);
  }
  /// `updates` updates from two environments with different numbers of agents.
  void learn(Learner& learner, std::uint64_t first, std::uint64_t updates, float log_probability = -1) const {
    for (std::uint64_t i = first; i < first + updates; ++i) {
      const int cells = static_cast<int>(network_->state_size());
      Rollout one = random_rollout(task_, cells, {2 * i, 4, 16, 8, log_probability});
      Rollout other = random_rollout(task_, cells, {2 * i + 1, 1, 16, 8, log_probability});
      update(learner, {&one, &other});
    }
  }
  static void update(Learner& learner, std::vector<Rollout*> rollouts) {
    const UpdateFigures figures = learner.update(rollouts);
    EXPECT_TRUE(learner.parameters().allFinite());
    for (const double figure : {
#define LEARNED(name, ...) figures.name,
#include "core/task/training_figures.inc"
             figures.localisation_loss, figures.orientation_loss})
      EXPECT_TRUE(std::isfinite(figure));
  }
  static LearnerState saved(const Learner& learner) {
    LearnerState state;
    learner.save(state);
    return state;
  }

  NetworkTask task_;
  mutable WorkerPool workers_{2};
  std::unique_ptr<AgentNetwork<float>> network_;
};
INSTANTIATE_TEST_SUITE_P(, LearnerContract, ::testing::ValuesIn(learners()),
                         [](const auto& tested) { return tested.param; });

TEST_P(LearnerContract, TellsWhatItIs) {
  const std::string &help = entry().help, &name = entry().name;
  EXPECT_FALSE(help.empty());
  EXPECT_FALSE(contains(help, "\n"));
  EXPECT_TRUE(std::all_of(name.begin(), name.end(),
                          [](unsigned char c) { return std::islower(c) || std::isdigit(c) || c == '_'; }));
}

TEST_P(LearnerContract, ParametersHaveDefaultsWithinTheirRanges) {
  for (const ParameterSpec& spec : entry().parameters) {
    EXPECT_FALSE(spec.help.empty()) << spec.name;
    EXPECT_NO_THROW(make(1, {{spec.name, spec.default_value}})) << spec.name;
    for (const double value : {spec.minimum - 1, spec.maximum * 1.1 + 1}) {
      EXPECT_TRUE(contains(error_of([&] { make(1, {{spec.name, value}}); }), spec.name));
    }
  }
  EXPECT_THROW(make(1, {{"no-such-parameter", 1}}), Error);
}

TEST_P(LearnerContract, SameSeedSameBitsOtherSeedOthers) {
  const auto one = make(1), again = make(1), other = make(2);
  ASSERT_EQ(one->parameters().size(), network_->parameter_count());
  const Vector<float> start = one->parameters();
  for (const auto& learner : {one.get(), again.get(), other.get()}) learn(*learner, 0, 5);
  EXPECT_EQ(one->parameters(), again->parameters());
  EXPECT_NE(one->parameters(), other->parameters());
  EXPECT_NE(one->parameters(), start) << "it learned nothing";
}

TEST_P(LearnerContract, ComesToTheEndOfItsTimeUnharmed) {
  const auto untold = make(1), told = make(1);
  for (std::uint64_t i = 0; i < 3; ++i) {
    told->set_progress(0);
    learn(*told, i, 1);
  }
  learn(*untold, 0, 3);
  EXPECT_EQ(told->parameters(), untold->parameters()) << "at the beginning there is nothing to do";
  for (const double share : {0.5, 0.999, 1.0}) {
    told->set_progress(share);
    learn(*told, 3, 1);
  }
}

TEST_P(LearnerContract, FreezesBitForBitOrSaysThatItCannot) {
  const auto learner = make(1), free = make(1);
  const Vector<float> start = learner->parameters();
  const Tensor &frozen = network_->tensors()[2], &before = network_->tensors()[0];
  const bool can = learner->freeze(std::span(&frozen, 1));
  EXPECT_EQ(learner->parameters(), start);
  learn(*learner, 0, 3);
  learn(*free, 0, 3);
  const auto part = [](const Vector<float>& parameters, const Tensor& tensor) {
    return Vector<float>(parameters.segment(tensor.offset, tensor.rows * tensor.cols));
  };
  if (can) {
    EXPECT_EQ(part(learner->parameters(), frozen), part(start, frozen));
    EXPECT_NE(part(learner->parameters(), before), part(start, before));
    EXPECT_NE(part(free->parameters(), frozen), part(start, frozen)) << "there was nothing to keep";
  } else {
    EXPECT_EQ(learner->parameters(), free->parameters()) << "it is as if nobody had asked";
  }
}

TEST_P(LearnerContract, GoesOnFromWhatItSavedBitForBit) {
  const auto straight = make(1), resumed = make(1);
  learn(*straight, 0, 3);
  const LearnerState middle = saved(*straight);
  ASSERT_TRUE(middle.tensors.contains("parameters"));
  EXPECT_EQ(middle.tensors.at("parameters"), straight->parameters());
  learn(*resumed, 70, 1);  // what it learned before is gone
  resumed->load(middle);
  EXPECT_TRUE(same(middle, saved(*resumed)));
  learn(*straight, 3, 3);
  learn(*resumed, 3, 3);
  EXPECT_EQ(straight->parameters(), resumed->parameters());
  EXPECT_TRUE(same(saved(*straight), saved(*resumed)));
  EXPECT_FALSE(same(saved(*straight), middle));
}

TEST_P(LearnerContract, RefusesWhatIsNotItsOwnAndIsAsBefore) {
  const auto learner = make(1), untouched = make(1);
  learn(*learner, 0, 2);
  learn(*untouched, 0, 2);
  const LearnerState good = saved(*learner);
  const auto expect_refused = [&](const LearnerState& state, const std::string& what) {
    EXPECT_TRUE(contains(error_of([&] { learner->load(state); }), GetParam()));
    EXPECT_TRUE(same(good, saved(*learner))) << what;
  };
  expect_refused({}, "nothing");
  for (const auto& [name, count] : good.counters) {
    LearnerState damaged = good;
    damaged.counters.erase(name);
    expect_refused(damaged, "no counter " + name);
  }
  for (const auto& [name, tensor] : good.tensors) {
    LearnerState damaged = good;
    damaged.tensors[name] = Vector<float>::Zero(tensor.size() + 1);
    expect_refused(damaged, "longer " + name);
    damaged.tensors.erase(name);
    expect_refused(damaged, "no tensor " + name);
    damaged = good;
    damaged.tensors[name](0) = std::numeric_limits<float>::quiet_NaN();
    expect_refused(damaged, "not a number in " + name);
  }
  const auto larger = network(9);
  expect_refused(saved(*make(*larger, 9, 1, {})), "another network");
  learn(*learner, 2, 2);
  learn(*untouched, 2, 2);
  EXPECT_EQ(learner->parameters(), untouched->parameters());
  learner->load(good);
}

/// One agent or many, environments of different sizes, the shortest sequences.
TEST_P(LearnerContract, TakesRolloutsOfAnyNumberOfAgents) {
  const auto learner = make(1);
  const int cells = static_cast<int>(network_->state_size());
  for (std::uint64_t i = 0; i < 3; ++i) {
    Rollout alone = random_rollout(task_, cells, {i, 1, 12, 12});
    update(*learner, {&alone});
  }
  Rollout one = random_rollout(task_, cells, {1, 1}), five = random_rollout(task_, cells, {2, 5}),
          two = random_rollout(task_, cells, {3, 2});
  const Vector<float> before = learner->parameters();
  update(*learner, {&one, &five, &two});
  EXPECT_NE(before, learner->parameters());
  const auto short_sequences = make(1);
  Rollout many = random_rollout(task_, cells, {5, 2, 24, 3});
  update(*short_sequences, {&many});
}

/// Actors may lag, and what they did may have become as good as impossible.
TEST_P(LearnerContract, BearsSamplesOfOlderParameters) {
  for (const float log_probability : {0.0f, -1e-6f, -30.0f, -200.0f, -1e9f, -std::numeric_limits<float>::infinity()})
    learn(*make(1), 0, 4, log_probability);
  const auto learner = make(1);
  for (int i = 0; i < 8; ++i) learn(*learner, 1, 1);  // the same again and again, ever staler
}

}  // namespace
}  // namespace citylearn::testing
