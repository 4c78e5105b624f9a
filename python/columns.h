// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include "python/env_group.h"

namespace citylearn::python {

/// New numpy arrays for the observations of B agents, which are written straight into them.
struct Columns {
  Columns(int agents, int dimension)
      : features({agents, dimension}),
        goal(agents),
        previous_action(agents),
        allowed({agents, kActions}),
        position(agents),
        reward(agents),
        flags(agents) {}
  Batch batch() {
    return {features.mutable_data(), goal.mutable_data(),     previous_action.mutable_data(),
            allowed.mutable_data(),  position.mutable_data(), reward.mutable_data(),
            flags.mutable_data()};
  }
  pybind11::tuple tuple() const {
    return pybind11::make_tuple(features, goal, previous_action, allowed, position, reward, flags);
  }

  pybind11::array_t<float> features;
  pybind11::array_t<std::int64_t> goal, previous_action;
  pybind11::array_t<std::int8_t> allowed;
  pybind11::array_t<std::int64_t> position;
  pybind11::array_t<double> reward;
  pybind11::array_t<std::uint8_t> flags;
};

}  // namespace citylearn::python
