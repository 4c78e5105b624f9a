// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

namespace citylearn {

// A route that crosses itself is a map (docs/decisions/0016-crossings.md). `turns`, one number a place, says where
// `stay` leads: at a crossing to the joined place of the other road, so that the agent faces along that one; elsewhere
// to the place itself. It is a permutation of the places, and empty where the route is a line.

/// Throws Error unless `turns` is empty or a permutation of 0 .. places - 1.
void check_turns(const std::vector<int>& turns, int places);

/// Returns the turns of the stretch first .. first + frames - 1 as a route of its own, places counted from its start.
/// Where a turn leads out of it, the turns from there on are followed until they come back; so it is a permutation
/// again. Returns an empty list when the stretch does not cross itself.
std::vector<int> turns_within(const std::vector<int>& turns, int first, int frames);

/// Returns the place to which `action` leads, which must be allowed there.
int place_after(int place, std::uint8_t action, const std::vector<int>& turns);

/// Returns the place to which `action`, which must be allowed at `place`, leads when it is done `times` times, on a
/// route of `places` places. At an end of the route the rest comes to nothing.
int place_after(int place, std::uint8_t action, const std::vector<int>& turns, int times, int places);

/// Returns the fewest steps from each of `places` places to `goal`; each next, previous or turn is one.
void distances_to(int goal, int places, const std::vector<int>& turns, std::vector<int>& distances);

}  // namespace citylearn
