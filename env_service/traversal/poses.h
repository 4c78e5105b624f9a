// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "traversal.h"

namespace citylearn {

/// Fills positions (and latitude and longitude) from a table with a header. Columns: "frame" (0-based) or "file" (the
/// picture's name) says which frame a row is for, otherwise rows are frames; the place is "lat" and "lon" in degrees,
/// or "metres" along the route, or "x" and "y" in metres; "z" is the height, in metres. "time" in seconds may be there
/// too. Frames without a row, and those whose fields are empty or nan, have no position. Throws Error naming the line:
/// a frame or file that isn't there or is there twice, no number, a place beyond the earth; or naming the missing
/// column.
void read_poses(const std::string& path, Traversal& traversal);

/// Reads pairs (frame of a, frame of b) of a table whose header names the two traversals; a row is a pair of frames.
/// Throws Error: another header, or a number that is not a frame.
std::vector<std::pair<int, int>> read_matches(const std::string& path, const std::string& a, const std::string& b);

}  // namespace citylearn
