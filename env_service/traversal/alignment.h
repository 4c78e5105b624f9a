// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "traversal.h"

namespace citylearn {

// Each function returns for some frames of `sibling` the frames of `traversal` at the same places. Every Error names
// the sibling's frame and what to do.

/// Matches frame i with frame i. Throws Error when `traversal` is shorter.
std::vector<int> align_by_index(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal);

/// Matches by pairs (frame of sibling, frame of traversal) in any order, and in proportion between two pairs. Of
/// several pairs for one frame the first counts. Throws Error when a frame is before the first pair or after the last,
/// or a pair is beyond the recordings.
std::vector<int> align_by_matches(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                  std::vector<std::pair<int, int>> matches);

/// Matches the nearest position. Throws Error when positions are unknown or none is within `tolerance` metres.
std::vector<int> align_by_distance(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                   double tolerance);

/// Matches the nearest latitude and longitude along the route: of all choices within `tolerance` metres those that turn
/// round or go back the fewest times, and of these the nearest, so that a crossing does not mislead it. A drive the
/// other way is followed backwards, with a warning. Throws Error when positions are unknown or none is within
/// `tolerance` metres.
std::vector<int> align_by_gps(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                              double tolerance);

/// Warns when half of the pairs frames[i] and found[i] are farther apart by latitude and longitude than `tolerance` and
/// a twentieth of the route.
void warn_if_apart(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                   const std::vector<int>& found, double tolerance);

}  // namespace citylearn
