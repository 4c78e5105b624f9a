// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// An answer is right within so many frames.
inline constexpr int kPlaceTolerance = 2;

/// Whose frames are found again among those of the traversal learned from, and how.
struct RecognitionCase {
  std::string representation, method, query;
};

/// Over all frames of the world. Outcome: {"queries", "auc", "auc_low", "auc_high", "recall"}; the interval is of
/// resampled blocks of neighbouring frames.
Unit unit_of(const RecognitionCase& one, World& world);

}  // namespace citylearn::paper
