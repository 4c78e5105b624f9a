// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "env_service/dataset_io/traversal.h"

namespace citylearn {

// For each of some frames of `sibling` the frame of `traversal` at the same place. Every Error names the sibling's
// frame and what to do.

/// Frame i is frame i. Throws Error when `traversal` is shorter.
std::vector<int> align_by_index(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal);

/// By pairs (frame of sibling, frame of traversal) in any order: that of the pair, or between two pairs in proportion.
/// Of several pairs for one frame the first counts. Throws Error: before the first pair or behind the last, or pairs
/// beyond the recordings.
std::vector<int> align_by_matches(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                  std::vector<std::pair<int, int>> matches);

/// The frame with the nearest position. Throws Error: positions unknown, or none within `tolerance` metres.
std::vector<int> align_by_distance(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                   double tolerance);

/// The frame with the nearest latitude and longitude, following the route: of all choices within `tolerance` metres
/// those that never go back (else: that go back the fewest times), and of these the nearest, so that a crossing doesn't
/// mislead it. Throws Error: positions unknown, or none within `tolerance` metres.
std::vector<int> align_by_gps(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                              double tolerance);

}  // namespace citylearn
