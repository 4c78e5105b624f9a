// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <string>
#include <vector>

#include "traversal.h"

namespace citylearn {

/// Coordinates in the order of a drive, NaN where unknown: degrees north and east (WGS 84), or metres of a plane.
struct Places {
  std::vector<double>&a, &b;
  std::vector<double> times = {};                     ///< seconds; empty or falling: rows are a second apart
  bool on_earth = true;                               ///< degrees, not metres
  std::string where = {}, what = "places";            ///< file or folder, and what its rows are, for messages
  std::function<std::string(std::size_t)> name = {};  ///< of a row, for messages: "frame 7"
  bool warns_of_jumps = true;
};

/// Replaces places that no vehicle can have reached, and counts them in one warning that names the first. Between
/// places at most 100 m apart they are interpolated, elsewhere they become unknown. Impossible are
///   - 0, 0 on the earth, unless other places are within 10 km of it, as in simulators;
///   - short stretches too far from those before and after: more than 100 m (on a plane 10 m) and 25 times the way at
///     the drive's usual speed; for one place there and back 3/10 of that. The most places possible are kept, and a
///     stretch of a tenth of them is believed;
///   - copies of one place, 4 or more, from which the drive then jumps as far as it should have come meanwhile.
/// Returns the rows before which the drive still jumps, of which it warns. Throws Error when a place is not on the
/// earth, when all are in radians, when more than a quarter cannot be, or when it jumps by 30 km or more than 3 times.
std::vector<std::size_t> forget_impossible(const Places& places);

/// Returns whether there may be a place on the earth at such a height, in metres.
constexpr bool is_height(double metres) { return metres > -500 && metres < 10000; }
/// Replaces heights that are unknown, or none, by what is between those known before and after; empties them where none
/// is known.
void fill_heights(std::vector<double>& metres);

/// Forgets impossible places of a traversal as it was read, and measures its positions anew where they came from such
/// places.
void forget_impossible(Traversal& traversal, const std::string& folder);

}  // namespace citylearn
