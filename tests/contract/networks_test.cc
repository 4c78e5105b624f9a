// SPDX-License-Identifier: Apache-2.0
// What every registered network keeps to.
#include <gtest/gtest.h>

#include "core/util/error.h"
#include "policy_service/network/layers/layers.h"
#include "tests/support/networks/carried_state.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using NetworkEntry = NetworkRegistry<double>::Entry;

std::vector<const NetworkEntry*> all_networks() { return NetworkRegistry<double>::instance().entries(); }

class Networks : public ::testing::TestWithParam<const NetworkEntry*> {
 protected:
  Networks()
      : small(small_network(GetParam()->name)),
        task(small_task(small.features)),
        network(create(task)),
        workspace(network->make_workspace()) {
    Random random{5};
    network->initialise(random, parameters);
    for (double& value : parameters) value += 0.1 * random.normal();
  }

  std::unique_ptr<AgentNetwork<double>> create(const NetworkTask& for_task) const {
    return GetParam()->create(Parameters(GetParam()->name, GetParam()->parameters, small.parameters), for_task);
  }

  Matrix<double> start(int agents) const { return some_state(*network, agents); }

  /// Gradient of a sum of all heads, each number weighted by its index.
  Vector<double> gradient(const NetworkInputs<double>& inputs, const Matrix<double>& state) {
    workspace->localise = true;
    network->forward(parameters, inputs, state, *workspace);
    Heads<double> derivative = workspace->heads;
    for (Matrix<double>* part : {&derivative.logits, &derivative.values, &derivative.auxiliary})
      for (std::ptrdiff_t i = 0; i < part->size(); ++i) part->data()[i] = 1 + static_cast<double>(i % 7);
    Vector<double> result = Vector<double>::Zero(parameters.size());
    network->backward(parameters, inputs, *workspace, derivative, result);
    return result;
  }

  const SmallNetwork small;
  const NetworkTask task;
  const std::unique_ptr<AgentNetwork<double>> network;
  const std::unique_ptr<Workspace<double>> workspace;
  Vector<double> parameters;
};

INSTANTIATE_TEST_SUITE_P(All, Networks, ::testing::ValuesIn(all_networks()),
                         [](const auto& tested) { return tested.param->name; });

TEST_P(Networks, CarryTheirStateFromCallToCall) {
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  expect_carried_state(*network, parameters, inputs, start(inputs.agents));
}

/// The backward pass is the derivative of the forward pass, as central differences see it.
TEST_P(Networks, DifferentiateWhatTheyCompute) {
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  const Matrix<double> begin = start(inputs.agents);
  workspace->localise = true;
  network->forward(parameters, inputs, begin, *workspace);
  Heads<double> weights = workspace->heads;
  for (Matrix<double>* part : {&weights.logits, &weights.values, &weights.auxiliary})
    for (std::ptrdiff_t i = 0; i < part->size(); ++i) {
      const bool masked = part == &weights.logits && part->data()[i] < 0.5 * kMasked;
      part->data()[i] = masked ? 0 : 1 + static_cast<double>(i % 7);
    }
  Vector<double> gradient_of_all = Vector<double>::Zero(parameters.size());
  network->backward(parameters, inputs, *workspace, weights, gradient_of_all);
  const auto sum = [&] {
    network->forward(parameters, inputs, begin, *workspace);
    const Heads<double>& heads = workspace->heads;
    return heads.logits.cwiseProduct(weights.logits).sum() + heads.values.cwiseProduct(weights.values).sum() +
           heads.auxiliary.cwiseProduct(weights.auxiliary).sum();
  };
  const double largest = gradient_of_all.cwiseAbs().maxCoeff();
  EXPECT_GT(largest, 0);
  const std::ptrdiff_t every = std::max<std::ptrdiff_t>(1, parameters.size() / 500);
  EXPECT_EQ(gradient_of_all.head(small.told).norm(), 0);
  for (std::ptrdiff_t i = small.told; i < parameters.size(); i += every)
    ASSERT_NEAR(gradient_of_all(i), central_difference(parameters(i), sum), 1e-5 * largest) << "parameter " << i;
}

/// It makes no difference whether what several agents see stands once or several times.
TEST_P(Networks, DoNotCareWhatIsShared) {
  const NetworkInputs<double> shared = some_inputs(task, task.frames), apart = some_inputs(task, task.frames, false);
  ASSERT_LT(shared.distinct, apart.distinct);
  const Matrix<double> begin = start(shared.agents);
  const Vector<double> gradient_shared = gradient(shared, begin);
  const Heads<double> heads = workspace->heads;
  const Matrix<double> state = workspace->state;
  const Vector<double> gradient_apart = gradient(apart, begin);
  EXPECT_GT(gradient_apart.norm(), 0);
  EXPECT_TRUE(gradient_shared.isApprox(gradient_apart, 1e-9));
  EXPECT_TRUE(heads.logits.isApprox(workspace->heads.logits, 1e-9));
  EXPECT_TRUE(heads.values.isApprox(workspace->heads.values, 1e-9));
  EXPECT_TRUE(state.isApprox(workspace->state, 1e-9));
}

/// Under one number of Workspace::fixed it may keep what it made of things; another number, or other things at a place,
/// and it may not.
TEST_P(Networks, KeepNothingThatIsOutOfDate) {
  NetworkInputs<double> inputs = some_inputs(task, task.frames);
  const Matrix<double> begin = start(inputs.agents);
  const auto fresh = network->make_workspace();
  const auto agree = [&](const std::string& when) {
    network->forward(parameters, inputs, begin, *workspace);
    fresh->fixed = 0;
    network->forward(parameters, inputs, begin, *fresh);
    EXPECT_TRUE(workspace->heads.logits.isApprox(fresh->heads.logits, 1e-9)) << when;
    EXPECT_TRUE(workspace->heads.values.isApprox(fresh->heads.values, 1e-9)) << when;
  };
  workspace->fixed = 1;
  agree("at first");
  agree("the second time");
  inputs.features.leftCols(inputs.distinct) *= 1.1;
  agree("other things");
  parameters *= 1.1;
  workspace->fixed = 2;
  agree("other parameters");
  workspace->fixed = 0;
  parameters *= 1.1;
  agree("parameters that change");
}

/// An experience of the route that says nothing new changes nothing, and neither does their order.
TEST_P(Networks, TakeSeveralExperiencesOfTheRoute) {
  const NetworkTask several = small_task(small.features, 3);
  NetworkTask twice = several, turned = several;
  const std::ptrdiff_t n = task.frames;
  twice.reference.conservativeResize(Eigen::NoChange, 4 * n);
  twice.reference.rightCols(n) = several.reference.middleCols(n, n);
  turned.reference.leftCols(n) = several.reference.rightCols(n);
  turned.reference.rightCols(n) = several.reference.leftCols(n);
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  const Matrix<double> begin = start(inputs.agents);
  const auto logits = [&](const NetworkTask& of) {
    const auto built = create(of);
    const auto work = built->make_workspace();
    built->forward(parameters, inputs, begin, *work);
    return Matrix<double>(work->heads.logits);
  };
  EXPECT_TRUE(logits(several).isApprox(logits(twice), 1e-9));
  EXPECT_TRUE(logits(several).isApprox(logits(turned), 1e-9));
  if (GetParam()->name.starts_with("place_")) {
    EXPECT_NE(logits(several), logits(task)) << "they are looked at";
  }
}

/// A task without features is worked on, or refused by a line that says what is needed.
TEST_P(Networks, SayWhatTheyCannotWorkWith) {
  for (const int features : {0, 1}) {
    NetworkTask other = task;
    other.features = features;
    other.reference.resize(0, 0);
    try {
      const auto built = create(other);
      const NetworkTask plain = small_task(features);
      NetworkInputs<double> inputs = some_inputs(plain, plain.frames);
      Vector<double> numbers;
      Random random{5};
      built->initialise(random, numbers);
      const auto work = built->make_workspace();
      built->forward(numbers, inputs, Matrix<double>::Zero(built->state_size(), inputs.agents), *work);
      EXPECT_TRUE(work->heads.values.allFinite());
    } catch (const Error& error) {
      EXPECT_TRUE(contains(error.what(), "features"));
    }
  }
}

TEST(RawImages, RefusesWhatIsNoPicture) {
  const auto& entry = NetworkRegistry<float>::instance().find("network", "raw_images");
  const std::string what =
      error_of([&] { entry.create(Parameters(entry.name, entry.parameters, {}), small_task(64)); });
  for (const char* part : {"are 64", "84 x 84 pixels in colour has 21168", "raw84"}) EXPECT_TRUE(contains(what, part));
}

}  // namespace
}  // namespace citylearn::testing
