// SPDX-License-Identifier: Apache-2.0
#pragma once

// Definitions of autodiff_network.h, which includes this file.
#include "policy_service/network/autodiff/autodiff_network.h"

namespace citylearn {

template <class S>
Variable<S> ForwardPass<S>::features() const {
  return tape.constant(inputs.features.leftCols(inputs.distinct));
}

template <class S>
Variable<S> ForwardPass<S>::goals(int frames) const {
  Matrix<S> goals(1, static_cast<std::ptrdiff_t>(inputs.goal.size()));
  for (std::ptrdiff_t i = 0; i < goals.cols(); ++i)
    goals(0, i) = static_cast<S>(inputs.goal[static_cast<std::size_t>(i)]) / static_cast<S>(frames) - S(0.5);
  return tape.constant(goals);
}

template <class S>
Variable<S> ForwardPass<S>::actions() const {
  Matrix<S> actions = Matrix<S>::Zero(2 * kActions, static_cast<std::ptrdiff_t>(inputs.allowed.size()));
  for (std::ptrdiff_t i = 0; i < actions.cols(); ++i) {
    const auto index = static_cast<std::size_t>(i);
    if (inputs.previous_action[index] < kActions) actions(inputs.previous_action[index], i) = 1;
    for (int action = 0; action < kActions; ++action)
      if (!(inputs.allowed[index] >> action & 1)) actions(kActions + action, i) = 1;
  }
  return tape.constant(actions);
}

template <class S>
Variable<S> ForwardPass<S>::wiped(const Variable<S>& before, int step) const {
  Vector<S> factors(inputs.agents);
  for (int b = 0; b < inputs.agents; ++b)
    factors[b] = inputs.first[static_cast<std::size_t>(step) * static_cast<std::size_t>(inputs.agents) +
                              static_cast<std::size_t>(b)]
                     ? S(0)
                     : S(1);
  return scale_columns(before, factors);
}

template <class S>
void AutodiffNetwork<S>::initialise(Random& random, Vector<S>& parameters) const {
  parameters.resize(layout_.size());
  for (std::size_t i = 0; i < starts_.size(); ++i) {
    auto tensor = layout_.view(parameters, i);
    tensor.setConstant(static_cast<S>(starts_[i].value));
    if (starts_[i].gain == 0) continue;
    // In the number type of the program that loads a plug-in, which has the function.
    Matrix<NetworkScalar> drawn(tensor.rows(), tensor.cols());
    orthogonal<NetworkScalar>(random, starts_[i].gain, {drawn.data(), drawn.rows(), drawn.cols()});
    tensor = drawn.template cast<S>();
  }
}

template <class S>
void AutodiffNetwork<S>::forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
                                 Workspace<S>& workspace) const {
  Work& work = static_cast<Work&>(workspace);
  work.tape.clear();
  work.tensors.clear();
  for (std::size_t i = 0; i < starts_.size(); ++i) {
    const auto tensor = layout_.view(parameters, i);
    // Where no backward pass follows, nothing needs to be recorded for one.
    work.tensors.push_back(work.fixed == 0 ? work.tape.parameter(tensor) : work.tape.constant(tensor));
  }
  work.result = run({work.tape, inputs, work.tensors, work.tape.constant(state), work.localise, work});

  const auto take = [](const char* what, const Variable<S>& from, std::ptrdiff_t rows, std::ptrdiff_t cols,
                       Matrix<S>& to) {
    const std::string wanted = std::to_string(rows) + " x " + std::to_string(cols);
    if (!from) throw Error(std::string("gives no ") + what, "network", "it must be " + wanted);
    if (from.rows() != rows || from.cols() != cols)
      throw Error(std::string("gives ") + what + " of " + from.size(), "network", "it must be " + wanted);
    to = from.value();
  };
  const std::ptrdiff_t columns = std::ptrdiff_t{inputs.agents} * inputs.steps;
  take("logits", work.result.logits, kActions, columns, work.heads.logits);
  take("values", work.result.values, 1, columns, work.heads.values);
  take("state", work.result.state, this->state_size(), inputs.agents, work.state);
  if (work.result.auxiliary)
    take("auxiliary", work.result.auxiliary, 2, columns, work.heads.auxiliary);
  else
    work.heads.auxiliary.resize(0, 0);
  mask_logits(inputs.allowed, work.heads.logits);
}

template <class S>
void AutodiffNetwork<S>::backward(const Vector<S>& /*parameters*/, const NetworkInputs<S>& /*inputs*/,
                                  Workspace<S>& workspace, const Heads<S>& derivative, Vector<S>& gradient) const {
  Work& work = static_cast<Work&>(workspace);
  std::vector<std::pair<Variable<S>, const Matrix<S>*>> derivatives = {{work.result.logits, &derivative.logits},
                                                                       {work.result.values, &derivative.values}};
  if (work.result.auxiliary && derivative.auxiliary.size() > 0)
    derivatives.push_back({work.result.auxiliary, &derivative.auxiliary});
  work.tape.backward(derivatives);
  for (std::size_t i = 0; i < work.tensors.size(); ++i) layout_.view(gradient, i) += work.tensors[i].gradient();
}

}  // namespace citylearn
