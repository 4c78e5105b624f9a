// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <vector>

#include "python/env_group.h"

namespace citylearn::python {

/// A vector, because pybind11 before 2.12 reads the strides of arrays made by a number alone, and of all that Eigen's
/// matrices become, from where NumPy 1 has them: under NumPy 2 they are wrong.
using ArrayShape = std::vector<pybind11::ssize_t>;

/// New numpy arrays for the observations of B agents, which are written straight into them.
struct Columns {
  Columns(int agents, int dimension)
      : features(ArrayShape{agents, dimension}),
        goal(ArrayShape{agents}),
        previous_action(ArrayShape{agents}),
        allowed(ArrayShape{agents, kActions}),
        position(ArrayShape{agents}),
        reward(ArrayShape{agents}),
        flags(ArrayShape{agents}),
        frame(ArrayShape{agents}) {}
  Batch batch() {
    return {features.mutable_data(), goal.mutable_data(),   previous_action.mutable_data(), allowed.mutable_data(),
            position.mutable_data(), reward.mutable_data(), flags.mutable_data(),           frame.mutable_data()};
  }
  pybind11::tuple tuple() const {
    return pybind11::make_tuple(features, goal, previous_action, allowed, position, reward, flags, frame);
  }

  pybind11::array_t<float> features;
  pybind11::array_t<std::int64_t> goal, previous_action;
  pybind11::array_t<std::int8_t> allowed;
  pybind11::array_t<std::int64_t> position;
  pybind11::array_t<double> reward;
  pybind11::array_t<std::uint8_t> flags;
  pybind11::array_t<std::int64_t> frame;
};

}  // namespace citylearn::python
