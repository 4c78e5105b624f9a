// SPDX-License-Identifier: Apache-2.0
// Gradients that a tape computes, against central differences and against those of the LSTM that is written by hand.
#include <gtest/gtest.h>

#include <functional>

#include "policy_service/network/autodiff/autodiff_network.h"
#include "tests/support/networks/small_networks.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Var = Variable<double>;

Matrix<double> random_matrix(std::uint64_t seed, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  Random random{seed};
  Matrix<double> result(rows, cols);
  for (double& value : result.reshaped()) value = random.normal();
  return result;
}

/// Differentiates a weighted sum of what `operation` makes of `inputs` by each number of them.
void expect_gradients(const std::string& name, std::vector<Matrix<double>> inputs,
                      const std::function<Var(const std::vector<Var>&)>& operation) {
  Tape<double> tape;
  std::vector<Var> variables;
  const auto result = [&] {
    tape.clear();
    variables.clear();
    for (const Matrix<double>& input : inputs) variables.push_back(tape.parameter(input));
    return operation(variables);
  };
  const Var first = result();
  const Matrix<double> weights = random_matrix(99, first.rows(), first.cols());
  tape.backward({{first, &weights}});
  std::vector<Matrix<double>> gradients;
  for (const Var& variable : variables) gradients.push_back(variable.gradient());
  const auto sum = [&] { return result().value().cwiseProduct(weights).sum(); };
  for (std::size_t i = 0; i < inputs.size(); ++i)
    for (std::ptrdiff_t k = 0; k < inputs[i].size(); ++k)
      EXPECT_NEAR(gradients[i].data()[k], central_difference(inputs[i].data()[k], sum), 1e-7)
          << name << ", input " << i;
}

TEST(Tape, OperationsAgreeWithCentralDifferences) {
  const Matrix<double> a = random_matrix(1, 4, 3), b = random_matrix(2, 4, 3), w = random_matrix(3, 2, 4),
                       bias = random_matrix(4, 4, 1);
  const Vector<double> factors = random_matrix(5, 3, 1);
  expect_gradients("product", {w, a}, [](const auto& v) { return v[0] * v[1]; });
  expect_gradients("factor", {a}, [](const auto& v) { return 2.5 * v[0]; });
  expect_gradients("sum", {a, b}, [](const auto& v) { return v[0] + v[1]; });
  expect_gradients("bias", {a, bias}, [](const auto& v) { return v[0] + v[1]; });
  expect_gradients("bias of one sample", {bias, bias}, [](const auto& v) { return v[0] + v[1]; });
  expect_gradients("difference", {a, b}, [](const auto& v) { return v[0] - v[1]; });
  expect_gradients("element-wise", {a, b}, [](const auto& v) { return cwise_product(v[0], v[1]); });
  expect_gradients("square", {a}, [](const auto& v) { return cwise_product(v[0], v[0]); });
  expect_gradients("scale", {a}, [&](const auto& v) { return scale_columns(v[0], factors); });
  expect_gradients("tanh", {a}, [](const auto& v) { return tanh(v[0]); });
  expect_gradients("sigmoid", {a}, [](const auto& v) { return sigmoid(v[0]); });
  expect_gradients("relu", {a}, [](const auto& v) { return relu(v[0]); });
  expect_gradients("softmax", {a}, [](const auto& v) { return softmax(v[0]); });
  expect_gradients("rows", {a}, [](const auto& v) { return rows(v[0], 1, 2); });
  expect_gradients("columns", {a}, [](const auto& v) { return columns(v[0], 1, 2); });
  expect_gradients("gather", {a}, [](const auto& v) { return gather_columns(v[0], {2, 0, 2, 2}); });
  expect_gradients("stack_rows", {a, w, b}, [](const auto& v) {
    return stack_rows<double>({v[0], v[1] * v[2], v[0]});
  });
  expect_gradients("stack_columns", {a, bias}, [](const auto& v) { return stack_columns<double>({v[1], v[0], v[1]}); });
  expect_gradients("used twice", {a, w}, [](const auto& v) {
    const Var hidden = tanh(v[1] * v[0]);
    return cwise_product(hidden, sigmoid(hidden)) + hidden;
  });
}

TEST(Tape, SoftmaxBearsLargeNumbers) {
  Tape<double> tape;
  const Var chances = softmax(tape.constant(Matrix<double>{{1e9, 0}, {0, -1e9}, {1e9, 0}}));
  EXPECT_TRUE(chances.value().isApprox(Matrix<double>{{0.5, 0.5}, {0, 0}, {0.5, 0.5}}));
}

TEST(Tape, NamesSizesThatDoNotFit) {
  Tape<double> tape;
  const Var a = tape.parameter(random_matrix(1, 4, 3)), b = tape.parameter(random_matrix(2, 2, 5));
  const std::vector<std::function<Var()>> wrong = {[&] { return a * b; },
                                                   [&] { return a + b; },
                                                   [&] { return a - b; },
                                                   [&] { return cwise_product(a, b); },
                                                   [&] {
                                                     return stack_rows<double>({a, b});
                                                   },
                                                   [&] {
                                                     return stack_columns<double>({a, b});
                                                   }};
  for (const auto& operation : wrong)
    for (const char* size : {"4 x 3", "2 x 5", "tape, "}) EXPECT_TRUE(contains(error_of(operation), size));
  EXPECT_TRUE(contains(error_of([&] { rows(a, 3, 2); }), "rows 3..4 of 4 x 3"));
  EXPECT_TRUE(contains(error_of([&] { columns(a, -1, 2); }), "columns -1..0 of 4 x 3"));
  EXPECT_TRUE(contains(error_of([&] { gather_columns(a, {3}); }), "column 3 of 4 x 3"));
  EXPECT_TRUE(contains(error_of([&] { scale_columns(a, Vector<double>(2)); }), "2 factors for a matrix of 4 x 3"));
  EXPECT_TRUE(contains(error_of([&] { tape.backward({{a, &b.value()}}); }), "a derivative is not 4 x 3"));
}

/// The network "features" (policy_service/network/agents/features.cc) once more, as a forward pass alone.
class Lstm : public AutodiffNetwork<double> {
 public:
  Lstm(int features, int frames, int hidden, int cells) : frames_(frames), cells_(cells) {
    weights("sensors.weight", hidden, features + 1);
    bias("sensors.bias", hidden);
    weights("lstm.input", 4 * cells, hidden + 2 * kActions);
    weights("lstm.recurrent", 4 * cells, cells);
    bias("lstm.bias", 4 * cells);
    weights("heads.weight", kActions + 1, cells);
    bias("heads.bias", kActions + 1);
    weights("auxiliary.weight", 2, cells);
    bias("auxiliary.bias", 2);
  }
  int state_size() const override { return 2 * cells_; }

 protected:
  ForwardResult<double> run(const ForwardPass<double>& pass) const override {
    const auto& w = pass.tensors;
    const Var sensed =
        stack_rows<double>({8.0 * gather_columns(pass.features(), pass.inputs.seen), 16.0 * pass.goals(frames_)});
    const Var entering = w[2] * stack_rows<double>({relu(w[0] * sensed + w[1]), pass.actions()}) + w[4];
    Var h = rows(pass.state, 0, cells_), c = rows(pass.state, cells_, cells_);
    std::vector<Var> all;
    for (int t = 0; t < pass.inputs.steps; ++t) {
      const Var gates =
          columns(entering, std::ptrdiff_t{t} * pass.inputs.agents, pass.inputs.agents) + w[3] * pass.wiped(h, t);
      c = cwise_product(sigmoid(rows(gates, cells_, cells_)), pass.wiped(c, t)) +
          cwise_product(sigmoid(rows(gates, 0, cells_)), tanh(rows(gates, 3 * cells_, cells_)));
      h = cwise_product(sigmoid(rows(gates, 2 * cells_, cells_)), tanh(c));
      all.push_back(h);
    }
    const Var states = stack_columns(all), heads = w[5] * states + w[6];
    return {rows(heads, 0, kActions), rows(heads, kActions, 1), stack_rows<double>({h, c}),
            pass.localise ? w[7] * states + w[8] : Var()};
  }

 private:
  const int frames_, cells_;
};

/// Heads, state and gradient of both are the same to rounding.
TEST(AutodiffNetwork, IsTheLstmThatIsWrittenByHand) {
  constexpr double kTolerance = 1e-12;
  const NetworkTask task = small_task(5);
  const auto& entry = NetworkRegistry<double>::instance().find("network", "features");
  const auto by_hand = entry.create(Parameters("features", entry.parameters, {{"hidden", 6}, {"cells", 4}}), task);
  const Lstm taped(5, task.frames, 6, 4);
  ASSERT_EQ(taped.parameter_count(), by_hand->parameter_count());
  for (std::size_t i = 0; i < taped.tensors().size(); ++i)
    ASSERT_EQ(taped.tensors()[i].name, by_hand->tensors()[i].name);
  Random random{4};
  Vector<double> parameters;
  by_hand->initialise(random, parameters);
  for (double& value : parameters) value += 0.1 * random.normal();
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  const Matrix<double> state = random_matrix(6, taped.state_size(), inputs.agents);
  const auto one = by_hand->make_workspace(), other = taped.make_workspace();
  for (const bool localise : {true, false, true}) {
    one->localise = other->localise = localise;
    by_hand->forward(parameters, inputs, state, *one);
    taped.forward(parameters, inputs, state, *other);
    EXPECT_TRUE(one->heads.logits.isApprox(other->heads.logits, kTolerance));
    EXPECT_TRUE(one->heads.values.isApprox(other->heads.values, kTolerance));
    EXPECT_TRUE(one->state.isApprox(other->state, kTolerance));
    Heads<double> derivative = other->heads;
    EXPECT_EQ(derivative.auxiliary.size() > 0, localise);
    if (localise) {
      EXPECT_TRUE(one->heads.auxiliary.isApprox(derivative.auxiliary, kTolerance));
    }
    for (Matrix<double>* part : {&derivative.logits, &derivative.values, &derivative.auxiliary})
      for (std::ptrdiff_t i = 0; i < part->size(); ++i) part->data()[i] = static_cast<double>(1 + i % 7);
    Vector<double> expected = Vector<double>::Ones(parameters.size()), gradient = expected;  // both add
    by_hand->backward(parameters, inputs, *one, derivative, expected);
    taped.backward(parameters, inputs, *other, derivative, gradient);
    for (const Tensor& tensor : taped.tensors())
      EXPECT_TRUE(expected.segment(tensor.offset, tensor.rows * tensor.cols)
                      .isApprox(gradient.segment(tensor.offset, tensor.rows * tensor.cols), kTolerance))
          << tensor.name;
  }
}

/// Says which head has a wrong size.
class Wrong : public AutodiffNetwork<double> {
 public:
  explicit Wrong(int state) : state_(state) { weights("weight", kActions, 5); }
  int state_size() const override { return state_; }

 protected:
  ForwardResult<double> run(const ForwardPass<double>& pass) const override {
    const Var logits = pass.tensors[0] * gather_columns(pass.features(), pass.inputs.seen);
    return {logits, state_ == 0 ? Var() : logits, pass.state};
  }

 private:
  const int state_;
};

TEST(AutodiffNetwork, SaysWhichHeadIsMissingOrOfAnotherSize) {
  const NetworkTask task = small_task(5);
  const NetworkInputs<double> inputs = some_inputs(task, task.frames);
  for (const int state : {0, 1}) {
    const Wrong network(state);
    Vector<double> parameters;
    Random random{1};
    network.initialise(random, parameters);
    const auto workspace = network.make_workspace();
    const std::string line =
        error_of([&] { network.forward(parameters, inputs, Matrix<double>::Zero(state, inputs.agents), *workspace); });
    EXPECT_TRUE(contains(line, state == 0 ? "gives no values" : "gives values of 3 x 18"));
    EXPECT_TRUE(contains(line, "1 x 18"));
  }
}

}  // namespace
}  // namespace citylearn::testing
