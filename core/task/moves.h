// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/task/action.h"

namespace citylearn {

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
