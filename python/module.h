// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>

namespace citylearn::python {

/// Throws KeyboardInterrupt and the like. Called without the GIL.
void check_signals();

/// Adds what citylearn/trajectories.py needs.
void define_trajectories(pybind11::module_& module);

}  // namespace citylearn::python
