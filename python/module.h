// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <pybind11/pybind11.h>
#include <unistd.h>

#include <memory>

namespace citylearn::python {

/// Deletes what has threads, but not in a forked process: threads are not forked, and could not be joined there.
struct DeleteUnlessForked {
  pid_t process = getpid();
  template <class Object>
  void operator()(Object* object) const {
    if (getpid() == process) delete object;
  }
};
template <class Object>
using UnlessForked = std::unique_ptr<Object, DeleteUnlessForked>;

/// Throws KeyboardInterrupt and the like. Called without the GIL.
void check_signals();

/// Lets processes that are forked from now on end without the DDS libraries' destructors: these would tell other
/// services that this process is gone.
void keep_participants_of_forked();

}  // namespace citylearn::python
