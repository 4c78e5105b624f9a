// SPDX-License-Identifier: Apache-2.0
// What the learners of this repository promise beyond learner_contract.cc: with a trainer, and without a single
// allocation.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <string>
#include <vector>

#include "policy_service/learning/trainer.h"
#include "tests/contract/random_rollout.h"
#include "tests/support/networks/small_city.h"
#include "tests/support/networks/small_networks.h"

namespace {
std::atomic<std::size_t> allocations{0};
}  // namespace

#if defined(__GLIBC__) && !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
// Counts what is allocated, Eigen's matrices too. (Sanitizers have a malloc of their own.)
#define COUNTS_ALLOCATIONS
extern "C" void* __libc_malloc(std::size_t);  // NOLINT: the C library's own name
extern "C" void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
#endif

namespace citylearn::testing {
namespace {

using LearnerEntry = LearnerRegistry::Entry;

class Learners : public ::testing::TestWithParam<const LearnerEntry*> {
 protected:
  const LearnerEntry& entry() const { return *GetParam(); }
  bool has(const std::string& parameter) const {
    const auto& specs = entry().parameters;
    return std::any_of(specs.begin(), specs.end(), [&](const ParameterSpec& spec) { return spec.name == parameter; });
  }
  /// Returns those of `values` that this learner knows.
  std::map<std::string, double> known(std::map<std::string, double> values) const {
    std::erase_if(values, [&](const auto& value) { return !has(value.first); });
    return values;
  }
  TrainerOptions small() const {
    TrainerOptions options = small_options("features");
    options.learner = entry().name;
    options.learner_parameters = known({{"minibatch", 3}, {"epochs", 2}, {"replay", 500}});
    return options;
  }
};

INSTANTIATE_TEST_SUITE_P(Registered, Learners, ::testing::ValuesIn(LearnerRegistry::instance().entries()),
                         [](const auto& tested) { return tested.param->name; });

/// A network's recommendation for one learner names a known learner, and a parameter that it or the trainer has.
TEST_P(Learners, AreRecommendedParametersThatExist) {
  const std::vector<ParameterSpec> of_trainer = Trainer::parameter_specs();
  for (const auto* network : NetworkRegistry<float>::instance().entries()) {
    EXPECT_NO_THROW(Trainer::recommended_parameters(network->name, entry().name)) << network->name;
    const auto all = Trainer::recommended_parameters(network->name, entry().name);
    for (const auto& [name, value] : network->recommended) {
      const std::size_t dot = name.find('.');
      if (dot == name.npos || name.starts_with("streets.")) continue;  // those for streets are the trainer's
      EXPECT_NO_THROW(LearnerRegistry::instance().find("learner", name.substr(0, dot))) << network->name;
      if (name.substr(0, dot) != entry().name) continue;
      const std::string own = name.substr(dot + 1);
      const std::string part = has(own) ? "learner" : "trainer";
      ASSERT_TRUE(all.at(part).contains(own)) << network->name << " " << name;
      EXPECT_EQ(all.at(part).at(own), value) << network->name << " " << name;
    }
  }
}

TEST_P(Learners, SameSeedSameBitsWhoeverComesFirst) { expect_reproducible(small_city(), small(), 3, 5); }

TEST_P(Learners, GoOnFromACheckpointByteForByte) {
  for (const int begun : {0, 3}) expect_resumable(small_city(), small(), begun, 3);
}

/// More agents than two pieces have, and more shards than a minibatch has sequences.
TEST_P(Learners, SameBytesOnAnyNumberOfThreads) {
  const Traversal city = small_city();
  for (const std::string agent : {"features", "place_filter", "baseline"}) {
    std::vector<Vector<float>> learned;
    for (const double shards : {1, 2, 5}) {
      TrainerOptions options = small_options(agent);
      options.learner = entry().name;
      options.learner_parameters = known({{"minibatch", 3}, {"epochs", 2}, {"replay", 500}, {"shards", shards}});
      std::string expected;
      for (const int threads : {1, 2, 4}) {
        options.threads = threads;
        Loop loop(city, options, 1, 40);
        for (int i = 0; i < 2; ++i) loop.update();
        const testing::Folder folder;
        write_checkpoint(folder / "checkpoint", loop.trainer.checkpoint());
        const std::string file = contents(folder / "checkpoint");
        if (threads == 1) {
          expected = file;
          learned.push_back(loop.trainer.agent().parameters);
        }
        EXPECT_TRUE(file == expected) << agent << ", " << shards << " shards, " << threads << " threads";
      }
    }
    if (has("shards")) {
      EXPECT_NE(learned[0], learned[1]) << "shards decide how gradients are rounded";
      EXPECT_NE(learned[1], learned[2]);
    }
  }
}

TEST_P(Learners, FallWithTheClockWhereThatIsFaster) {
  const Traversal city = small_city();
  TrainerOptions options = small();
  for (const auto& [name, value] : known({{"learning-rate", 0.001}, {"learning-rate-end", 0}}))
    options.learner_parameters[name] = value;
  Loop loop(city, options), untold(city, options);
  loop.trainer.set_progress(0);
  EXPECT_DOUBLE_EQ(loop.update().learning_rate, 0.001);
  untold.update();
  EXPECT_EQ(loop.trainer.agent().parameters, untold.trainer.agent().parameters);
  loop.trainer.set_progress(0.75);
  EXPECT_NEAR(loop.update().learning_rate, 0.00025, 1e-12);
  loop.trainer.set_progress(1.1);
  const Vector<float> before = loop.trainer.agent().parameters;
  EXPECT_EQ(loop.update().learning_rate, 0);
  EXPECT_EQ(loop.trainer.agent().parameters, before);
}

/// Room is taken at first; later updates with rollouts of the same size take none.
TEST_P(Learners, AllocateNothingOnceWarm) {
#ifndef COUNTS_ALLOCATIONS
  GTEST_SKIP() << "allocations are not counted here";
#endif
  const NetworkTask task = task_of(small_city());
  const auto& network_entry = NetworkRegistry<float>::instance().find("network", "features");
  const Parameters network_parameters("features", network_entry.parameters, {{"hidden", 8}, {"cells", 6}});
  const auto network = network_entry.create(network_parameters, task);
  WorkerPool workers(2);
  const auto learner =
      entry().create(Parameters(entry().name, entry().parameters, known({{"minibatch", 3}, {"replay", 100}})),
                     LearnerTask{*network, "features", network_parameters, task, workers, 1, 100000});
  for (std::uint64_t i = 0; i < 20; ++i) {
    Rollout rollout = random_rollout(task, network->state_size(), {i});
    Rollout* const one[] = {&rollout};
    const std::size_t before = allocations;
    learner->update(one);
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
}  // namespace citylearn::testing
