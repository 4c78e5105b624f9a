// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "traversal.h"

namespace citylearn {

/// Counterparts by sight in `traversal` for frames of a sibling.
struct SightAlignment {
  std::vector<int> found;         ///< a frame of the traversal for each; in proportion where it has no counterpart
  std::vector<bool> unmatched;    ///< which have none; empty when all have one
  std::vector<float> confidence;  ///< of each pair: 0, as by chance or none, to 1
  std::string summary;            ///< in one line: "winter: 412 of 430 frames show places of summer, ..."
  bool elsewhere = false;         ///< one in five counterparts lies three frames or more from the equal index
};

/// Matches what `traversal` shows with the part of `sibling` about `frames`, which ascend. Both have pictures, or
/// features of one dimension. Throws Error when they have not, or no order of the one looks like the other.
SightAlignment align_by_sight(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal);

}  // namespace citylearn
