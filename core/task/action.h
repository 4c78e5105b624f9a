// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace citylearn {

/// Number of actions of the task (Chancán & Milford, 2020): stay, next, previous.
inline constexpr int kActions = 3;

/// The actions, as they stand in every message, and the mark of "no action yet".
enum : std::uint8_t { kStay = 0, kNext = 1, kPrevious = 2, kNoAction = 255 };

}  // namespace citylearn
