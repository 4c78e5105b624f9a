// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>

#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

/// Tasks first .. first + count - 1 of an evaluation.
struct TaskRange {
  std::uint32_t first = 0, count = 0;
};

/// The tasks of an evaluation on one traversal in waves: task 0, task 1, then 2 .. 3, 4 .. 7 and so on. A wave's tasks
/// know what was seen of the traversal in earlier waves. So the condition is known soon, and yet a task's result does
/// not depend on which env_service performs it, nor on the order within the wave. A policy that learns nothing from
/// what was seen performs all tasks but the first in one wave.
class TaskWaves {
 public:
  explicit TaskWaves(std::uint32_t tasks) : tasks_(tasks), wave_{0, tasks > 0 ? 1u : 0u} {}

  bool done() const { return wave_.count == 0; }
  const TaskRange& wave() const { return wave_; }
  /// Returns what was seen in earlier waves.
  const SeenFeatures& known() const { return known_; }
  /// Goes on to the next wave. `seen`: in each task of this one, as Policy::seen().
  void next(const std::map<std::uint32_t, SeenFeatures>& seen);

 private:
  std::uint32_t tasks_;
  TaskRange wave_;
  SeenFeatures known_;
};

}  // namespace citylearn
