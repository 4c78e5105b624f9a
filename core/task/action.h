// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace citylearn {

/// Number of actions of the task (Chancán & Milford, 2020): stay, next, previous.
inline constexpr int kActions = 3;

/// The actions, as they stand in every message, and the mark of "no action yet".
enum : std::uint8_t { kStay = 0, kNext = 1, kPrevious = 2, kNoAction = 255 };

/// Returns the place to which `action` leads, which must be allowed there.
constexpr int place_after(int place, std::uint8_t action) {
  return action == kNext ? place + 1 : action == kPrevious ? place - 1 : place;
}

/// Returns the place to which `action`, which must be allowed at `place`, leads when it is done `times` times, on a
/// route of `places` places. At an end of the route the rest comes to nothing.
constexpr int place_after(int place, std::uint8_t action, int times, int places) {
  for (int i = 0; i < times; ++i)
    if (const int next = place_after(place, action); next >= 0 && next < places) place = next;
  return place;
}

}  // namespace citylearn
