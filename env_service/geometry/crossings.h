// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace citylearn {

/// Options for joining places where a route passes a spot again.
struct CrossingOptions {
  double metres = 10;  ///< places at most so far apart can be joined
  int spacing = 5;     ///< frames: joined ones lie further apart along the route, and so do the joins of a road
};

/// Turns of a recorded route of F frames (core/task/route_map.h). Two frames within `metres` of each other are of
/// different stretches when the way between them goes further off than twice that. While two stretches run within it
/// they are one crossing, whose nearest pair is joined, so that a loop driven twice is joined once; where further
/// stretches pass the same spot, all of them are joined in a cycle, in the order of their frames. No frame is joined
/// twice. `latitude` and `longitude` in degrees, NaN where unknown, or empty. Empty when nothing is joined. Throws
/// Error: vectors of different length, metres or spacing not positive.
std::vector<int> find_turns(const std::vector<double>& latitude, const std::vector<double>& longitude,
                            const CrossingOptions& options);

/// 1.5 times the mean step between neighbours that are known: as far as the nearest frames of two roads that cross are
/// apart at most, with room for uneven steps. NaN when no two neighbours are known or nothing moves.
double crossing_reach(const std::vector<double>& latitude, const std::vector<double>& longitude);

/// Junctions of a map: for each the places joined there, lowest first, in the order of their turns.
std::vector<std::vector<int>> junctions_of(const std::vector<int>& turns);

}  // namespace citylearn
