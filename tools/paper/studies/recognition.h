// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// An answer is right when it is at most so many frames off.
inline constexpr int kPlaceTolerance = 2;

/// Which frames are recognised among those of the traversal learned from, and how.
struct RecognitionCase {
  std::string representation, method, query;
};

/// Over all frames of the world. Outcome: {"queries", "auc", "auc_low", "auc_high", "recall"}; the interval comes from
/// resampled blocks of neighbouring frames.
Unit unit_of(const RecognitionCase& one, World& world);

/// Adds its unit and returns {"representation", "method", "query", "unit"}.
Json add_case(const RecognitionCase& one, Work& work, World& world);

}  // namespace citylearn::paper
