// What every registered learner promises (policy_service/learner.h).
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cctype>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "policy_service/trainer.h"
#include "tests/support/small_city.h"

namespace {
std::atomic<std::size_t> allocations{0};
}  // namespace

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Counts what is allocated, Eigen's matrices too. (Sanitizers have a malloc of their own.)
#define COUNTS_ALLOCATIONS
extern "C" void* __libc_malloc(std::size_t);
extern "C" void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
#endif

namespace citylearn {
namespace {

using Entry = LearnerRegistry::Entry;

class Learners : public testing::TestWithParam<const Entry*> {
 protected:
  const Entry& entry() const { return *GetParam(); }
  bool has(const std::string& parameter) const {
    const auto& specs = entry().parameters;
    return std::any_of(specs.begin(), specs.end(), [&](const ParameterSpec& spec) { return spec.name == parameter; });
  }
  /// Those of `values` that this learner knows.
  std::map<std::string, double> known(std::map<std::string, double> values) const {
    std::erase_if(values, [&](const auto& value) { return !has(value.first); });
    return values;
  }
  TrainerOptions small(std::uint64_t seed = 1) const {
    TrainerOptions options;
    options.agent = "features";
    options.learner = entry().name;
    options.seed = seed;
    options.network_parameters = {{"hidden", 24}, {"cells", 16}};
    options.learner_parameters = known({{"minibatch", 3}, {"epochs", 2}, {"replay", 500}});
    options.trainer_parameters = {{"segment", 24}, {"sequence", 12}, {"steps", 20000}};
    return options;
  }
};

INSTANTIATE_TEST_SUITE_P(Registered, Learners, testing::ValuesIn(LearnerRegistry::instance().entries()),
                         [](const auto& tested) { return tested.param->name; });

/// A network, a learner for it and rollouts without a trainer.
class Bench {
 public:
  Bench(const Entry& entry, const std::map<std::string, double>& learner, std::uint64_t seed = 1, int cells = 6)
      : task_(task_of(city_)),
        network_parameters_("features", network_entry().parameters,
                            {{"hidden", 8}, {"cells", static_cast<double>(cells)}}),
        network_(network_entry().create(network_parameters_, task_)),
        learner_(entry.create(Parameters(entry.name, entry.parameters, learner),
                              LearnerTask{*network_, "features", network_parameters_, task_, seed, 100000})) {}

  Learner& learner() { return *learner_; }

  /// Agents that walk at random and tell of probabilities around `log_probability`.
  Rollout walk(std::uint64_t seed, int agents = 3, int steps = 24, int sequence = 12, float log_probability = -1) {
    Random random{seed, 99};
    Rollout rollout;
    rollout.resize(city_.dimension, network_->state_size(), steps, agents, sequence);
    for (float& value : rollout.states.reshaped()) value = static_cast<float>(random.uniform()) - 0.5f;
    rollout.max_steps = 16;
    rollout.inputs.frames = rollout.next.frames = city_.frames;
    for (int a = 0; a < agents; ++a) {
      int position = static_cast<int>(random.below(static_cast<std::uint64_t>(city_.frames)));
      bool first = true;
      std::uint8_t previous = kNoAction;
      int goal = 0;
      for (int t = 0; t <= steps; ++t) {
        NetworkInputs<float>& inputs = t < steps ? rollout.inputs : rollout.next;
        const std::ptrdiff_t column = t < steps ? t * agents + a : a;
        const auto i = static_cast<std::size_t>(column);
        if (first) goal = (position + 1 + static_cast<int>(random.below(10))) % city_.frames;
        inputs.see(column, position, task_.reference.col(position));
        inputs.position[i] = position;
        inputs.goal[i] = goal;
        inputs.first[i] = first;
        inputs.previous_action[i] = first ? std::uint8_t{kNoAction} : previous;
        inputs.allowed[i] = position == 0 ? 0b011 : position == city_.frames - 1 ? 0b101 : 0b111;
        if (t == steps) break;
        std::uint8_t action = kStay;
        do action = static_cast<std::uint8_t>(random.below(kActions));
        while (!(inputs.allowed[i] >> action & 1));
        position += action == kNext ? 1 : action == kPrevious ? -1 : 0;
        previous = action;
        rollout.action[i] = action;
        rollout.log_probability[i] = log_probability * static_cast<float>(0.5 + random.uniform());
        rollout.value[i] = 0.1f * static_cast<float>(random.normal());
        const bool reached = position == goal, cut = !reached && random.below(16) == 0;
        rollout.reward[i] = reached ? 1.0f : -0.0625f;
        rollout.ended[i] = reached ? Rollout::kTerminated : cut ? Rollout::kTruncated : Rollout::kGoesOn;
        rollout.final_value[i] = cut ? 0.2f : 0;
        first = reached || cut;
      }
    }
    return rollout;
  }

  UpdateFigures update(Rollout& rollout) {
    Rollout* const one[] = {&rollout};
    return learner_->update(one);
  }
  LearnerState saved() const {
    LearnerState state;
    learner_->save(state);
    return state;
  }

 private:
  static const NetworkRegistry<float>::Entry& network_entry() {
    return NetworkRegistry<float>::instance().find("network", "features");
  }
  Traversal city_ = small_city();
  NetworkTask task_;
  Parameters network_parameters_;
  std::unique_ptr<AgentNetwork<float>> network_;
  std::unique_ptr<Learner> learner_;
};

bool same(const LearnerState& one, const LearnerState& other) {
  return one.counters == other.counters &&
         std::equal(one.tensors.begin(), one.tensors.end(), other.tensors.begin(), other.tensors.end(),
                    [](const auto& a, const auto& b) {
                      return a.first == b.first && a.second.size() == b.second.size() && a.second == b.second;
                    });
}

void expect_finite(const Learner& learner, const UpdateFigures& figures) {
  EXPECT_TRUE(learner.parameters().allFinite());
  for (const double figure :
       {figures.policy_loss, figures.value_loss, figures.entropy, figures.divergence, figures.clipped,
        figures.localisation_loss, figures.orientation_loss, figures.gradient_norm, figures.learning_rate})
    EXPECT_TRUE(std::isfinite(figure));
}

TEST_P(Learners, TellWhatTheyAre) {
  EXPECT_FALSE(entry().help.empty());
  EXPECT_EQ(entry().help.find('\n'), entry().help.npos);
  EXPECT_TRUE(std::all_of(entry().name.begin(), entry().name.end(),
                          [](unsigned char c) { return std::islower(c) || std::isdigit(c) || c == '_'; }));
  for (const ParameterSpec& parameter : entry().parameters) {
    EXPECT_FALSE(parameter.help.empty()) << parameter.name;
    EXPECT_NO_THROW(Parameters(entry().name, entry().parameters, {{parameter.name, parameter.standard}}))
        << parameter.name;
  }
}

TEST_P(Learners, RefuseParametersOutOfRange) {
  ASSERT_FALSE(entry().parameters.empty());
  for (const ParameterSpec& parameter : entry().parameters)
    for (const double value : {parameter.minimum - 1, parameter.maximum * 1.1 + 1}) {
      try {
        Bench(entry(), {{parameter.name, value}});
        ADD_FAILURE() << parameter.name << " = " << value << " was taken";
      } catch (const Error& error) {
        EXPECT_NE(std::string(error.what()).find(parameter.name), std::string::npos) << error.what();
      }
    }
  EXPECT_THROW(Bench(entry(), {{"speed-of-light", 1}}), Error);
}

/// What a network recommends for one learner alone names a learner that there is, and a parameter that it or the
/// trainer has.
TEST_P(Learners, AreRecommendedParametersThatExist) {
  const std::vector<ParameterSpec> of_trainer = Trainer::parameter_specs();
  for (const auto* network : NetworkRegistry<float>::instance().entries()) {
    EXPECT_NO_THROW(Trainer::recommended_parameters(network->name, entry().name)) << network->name;
    const auto all = Trainer::recommended_parameters(network->name, entry().name);
    for (const auto& [name, value] : network->recommended) {
      const std::size_t dot = name.find('.');
      if (dot == name.npos) continue;
      EXPECT_NO_THROW(LearnerRegistry::instance().find("learner", name.substr(0, dot))) << network->name;
      if (name.substr(0, dot) != entry().name) continue;
      const std::string own = name.substr(dot + 1);
      const std::string part = has(own) ? "learner" : "trainer";
      ASSERT_TRUE(all.at(part).contains(own)) << network->name << " " << name;
      EXPECT_EQ(all.at(part).at(own), value) << network->name << " " << name;
    }
  }
}

TEST_P(Learners, SameSeedSameBitsWhoeverComesFirst) {
  const Traversal city = small_city();
  Loop one(city, small(), 3), other(city, small(), 3), third(city, small(2), 3);
  for (int i = 0; i < 5; ++i) {
    one.update();
    other.update(/*backwards=*/i % 2 == 0);
    third.update();
  }
  EXPECT_EQ(one.trainer.agent().parameters, other.trainer.agent().parameters);
  EXPECT_NE(one.trainer.agent().parameters, third.trainer.agent().parameters);
}

TEST_P(Learners, GoOnFromWhatWasSavedByteForByte) {
  const auto parameters = known({{"minibatch", 3}, {"replay", 100}});
  Bench straight(entry(), parameters), resumed(entry(), parameters, /*seed=*/1);
  for (std::uint64_t i = 0; i < 4; ++i) {
    Rollout rollout = straight.walk(i);
    straight.update(rollout);
  }
  const LearnerState middle = straight.saved();
  Rollout unlike = resumed.walk(77);
  resumed.update(unlike);  // what it learned before is gone
  resumed.learner().load(middle);
  EXPECT_TRUE(same(middle, resumed.saved()));
  for (std::uint64_t i = 4; i < 8; ++i) {
    Rollout rollout = straight.walk(i), copy = straight.walk(i);
    straight.update(rollout);
    resumed.update(copy);
  }
  EXPECT_TRUE(same(straight.saved(), resumed.saved()));
  EXPECT_FALSE(same(straight.saved(), middle));
}

TEST_P(Learners, GoOnFromACheckpointByteForByte) {
  const Traversal city = small_city();
  for (const int begun : {0, 3}) {
    const std::string file = testing::TempDir() + "/learner_" + entry().name;
    Loop straight(city, small(), 2), resumed(city, small(), 2);
    for (int i = 0; i < begun; ++i) straight.update();
    write_checkpoint(file, straight.trainer.checkpoint());
    resumed.trainer.load(read_checkpoint(file));
    for (int i = 0; i < 3; ++i) {
      straight.update();
      resumed.update();
    }
    EXPECT_EQ(straight.trainer.agent().parameters, resumed.trainer.agent().parameters) << begun;
  }
}

TEST_P(Learners, RefuseForeignOrDamagedStates) {
  Bench bench(entry(), known({{"replay", 100}}));
  Rollout rollout = bench.walk(1);
  bench.update(rollout);
  const LearnerState good = bench.saved();
  const auto expect_refused = [&](const LearnerState& state, const std::string& what) {
    try {
      bench.learner().load(state);
      ADD_FAILURE() << what << " was taken";
    } catch (const Error& error) {
      EXPECT_NE(std::string(error.what()).find(entry().name), std::string::npos) << error.what();
    }
    EXPECT_TRUE(same(good, bench.saved())) << what;
  };
  expect_refused({}, "nothing");
  for (const auto& [name, value] : good.counters) {
    LearnerState state = good;
    state.counters.erase(name);
    expect_refused(state, "no counter " + name);
  }
  for (const auto& [name, tensor] : good.tensors) {
    LearnerState state = good;
    state.tensors.erase(name);
    expect_refused(state, "no tensor " + name);
    state = good;
    state.tensors[name].conservativeResize(tensor.size() + 1);
    state.tensors[name](tensor.size()) = 0;
    expect_refused(state, "longer " + name);
    state = good;
    state.tensors[name](0) = std::numeric_limits<float>::quiet_NaN();
    expect_refused(state, "not a number in " + name);
  }
  Bench larger(entry(), known({{"replay", 100}}), 1, /*cells=*/7);
  expect_refused(larger.saved(), "another network");
  bench.learner().load(good);
}

/// One agent or many, environments of different sizes, minibatches larger than all there is.
TEST_P(Learners, TakeRolloutsOfAnyNumberOfAgents) {
  Bench bench(entry(), known({{"minibatch", 50}}));
  for (std::uint64_t i = 0; i < 3; ++i) {
    Rollout alone = bench.walk(i, 1, 12, 12);
    expect_finite(bench.learner(), bench.update(alone));
  }
  Rollout one = bench.walk(1, 1), five = bench.walk(2, 5), two = bench.walk(3, 2);
  const Vector<float> before = bench.learner().parameters();
  Rollout* const all[] = {&one, &five, &two};
  expect_finite(bench.learner(), bench.learner().update(all));
  EXPECT_NE(before, bench.learner().parameters());

  Bench short_sequences(entry(), known({{"minibatch", 4}, {"epochs", 1}}));
  Rollout many = short_sequences.walk(5, 2, 24, 3);
  expect_finite(short_sequences.learner(), short_sequences.update(many));
}

/// Actors may lag, and what they did may have become as good as impossible.
TEST_P(Learners, BearSamplesOfOlderParameters) {
  for (const float log_probability : {0.0f, -1e-6f, -30.0f, -200.0f, -1e9f, -std::numeric_limits<float>::infinity()}) {
    Bench bench(entry(), known({{"minibatch", 3}}));
    for (std::uint64_t i = 0; i < 4; ++i) {
      Rollout rollout = bench.walk(i, 3, 24, 12, log_probability);
      expect_finite(bench.learner(), bench.update(rollout));
    }
  }
  Bench old(entry(), known({{"minibatch", 3}})), late(entry(), known({{"minibatch", 3}}));
  Rollout first = old.walk(1), second = old.walk(2);
  for (int i = 0; i < 8; ++i) {  // the same again and again, ever staler
    old.update(first);
    expect_finite(old.learner(), old.update(second));
  }
}

/// Room is taken at first; later updates with rollouts of the same size take none.
TEST_P(Learners, AllocateNothingOnceWarm) {
#ifndef COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations are not counted here";
#endif
  Bench bench(entry(), known({{"minibatch", 3}, {"replay", 100}}));
  for (std::uint64_t i = 0; i < 20; ++i) {
    Rollout rollout = bench.walk(i);
    Rollout* const one[] = {&rollout};
    const std::size_t before = allocations;
    bench.learner().update(one);
    if (i >= 10) {
      EXPECT_EQ(allocations - before, 0u) << "update " << i;
    }
  }
  EXPECT_GT(allocations, 100u);  // they are counted
}

/// Looking at it: a blind sweep has SPL 0.85 or less.
TEST_P(Learners, LearnTheSmallCity) {
  const Traversal city = small_city();
  TrainerOptions options = small();
  options.agent = "place_filter";
  options.network_parameters.clear();
  options.learner_parameters =
      known({{"learning-rate", 3e-3}, {"minibatch", 8}, {"entropy-until", 0.7}, {"gamma", 0.95}});
  options.trainer_parameters = {{"segment", 32},      {"sequence", 16},     {"steps", 50000},
                                {"noise-frame", 0.3}, {"noise-place", 0.3}, {"noise-episode", 0.3}};
  Loop loop(city, options, 1, 16);
  while (!loop.trainer.done()) loop.update();
  EXPECT_GT(loop.trainer.progress().spl, 0.95);
  EXPECT_TRUE(loop.trainer.progress().episodes_to_spl95.has_value());
}

}  // namespace
}  // namespace citylearn
