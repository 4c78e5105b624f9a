// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

#include "dashboard/store/store_reader.h"

namespace citylearn {

/// Figures of one policy on the tasks of one traversal: means over tasks; fractions are 0..1.
struct EvaluationFigures {
  std::uint64_t tasks = 0;
  double completed = 0, failed = 0;
  double spl = 0, spl_low = 0, spl_high = 0;  ///< interval of 95 %: percentiles of 1,000 resamples of the tasks
  double reward = 0;
  double mean_steps = 0;     ///< failed tasks count with all steps they took
  double shortest_mean = 0;  ///< frames
  double excess = 0;         ///< taken / shortest, mean over completed tasks; NaN when none was completed
};
/// Returns the figures of `tasks`, which must not be empty. The same tasks give the same interval.
EvaluationFigures evaluate(std::span<const StoreReader::TaskRow> tasks);

}  // namespace citylearn
