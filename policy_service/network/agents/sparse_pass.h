// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "policy_service/network/agents/sparse_inputs.h"

namespace citylearn::place_filter {

/// The passes of place_filter where beliefs are sparse, up to the head's inputs.
template <class S>
class SparsePass {
 public:
  SparsePass(const PlaceKeys<S>& keys, const Motion<S>& motion) : filter_(keys, motion) {}
  void set_motion(S slip, S kidnap) { filter_.set_motion(slip, kidnap); }

  /// Sets the inputs that depend on beliefs, and the state after the last step. `state` is that before the first.
  void forward(const NetworkInputs<S>& inputs, const Matrix<S>& state, const Scalars<S>& s, Matrix<S>& head_input,
               Matrix<S>& next_state) {
    const auto agents = static_cast<std::size_t>(inputs.agents), columns = inputs.goal.size();
    inputs_.set_nearness(s.nearness, inputs.frames);
    before_.resize(agents);
    steps_.resize(columns);
    sides_.resize(columns);
    for (std::size_t column = 0; column < columns; ++column) {
      SparseStep<S>& step = steps_[column];
      step.before = column < agents ? &before_[column] : &steps_[column - agents].after;
      step.seen = inputs.seen[column];
      step.goal = inputs.goal[column];
      step.action = inputs.previous_action[column];
      step.allowed = inputs.allowed[column];
      step.first = inputs.first[column];
      if (column < agents && !step.first)
        before_[column].load(state.col(static_cast<std::ptrdiff_t>(column)), inputs.frames);
    }
    for (std::size_t tick = 0; tick < columns; tick += agents)
      filter_.advance(inputs.features, inputs.frames, s.evidence, s.tempering, std::span(steps_).subspan(tick, agents));
    for (std::size_t column = 0; column < columns; ++column)
      sides_[column] = inputs_.read(steps_[column], inputs.frames, s.turnings(steps_[column].action),
                                    head_input.col(static_cast<std::ptrdiff_t>(column)));
    next_state.resize(SparseBelief<S>::kStateSize, inputs.agents);
    for (std::size_t agent = 0; agent < agents; ++agent)
      steps_[columns - agents + agent].after.store(next_state.col(static_cast<std::ptrdiff_t>(agent)));
  }

  /// Adds to the derivatives by the scalars.
  void backward(const NetworkInputs<S>& inputs, const Scalars<S>& s, const Matrix<S>& by_input, Scalars<S>& ds) {
    for (std::size_t column = 0; column < steps_.size(); ++column) {
      const SparseStep<S>& step = steps_[column];
      const Sides<S>& sides = sides_[column];
      const auto by = inputs_.unread(step, inputs.frames, s.turnings(step.action), sides,
                                     by_input.col(static_cast<std::ptrdiff_t>(column)));
      ds.nearness += by.nearness;
      if (step.action == kPrevious) ds.turning += by.sides.before * sides.before / s.turning;
      if (step.action == kNext) ds.turning += by.sides.after * sides.after / s.turning;
    }
  }

 private:
  SparseFilter<S> filter_;
  SparseInputs<S> inputs_;
  std::vector<SparseBelief<S>> before_;  // B, before the first step
  std::vector<SparseStep<S>> steps_;     // TB
  std::vector<Sides<S>> sides_;          // TB, what the inputs have read
};

}  // namespace citylearn::place_filter
