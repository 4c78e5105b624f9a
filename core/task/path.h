// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "core/task/action.h"

namespace citylearn {

// The actions of an episode as EpisodeStat.path holds them: 2 bits each, the first in the lowest bits of the first
// octet.

/// Returns how many octets a path of so many steps has.
constexpr std::uint64_t path_octets(std::uint64_t steps) { return (steps + 3) / 4; }

/// Adds the action of step number `step`, from 0; call it for each step in order.
inline void append_action(std::vector<std::uint8_t>& path, std::size_t step, std::uint8_t action) {
  if (step % 4 == 0) path.push_back(0);
  path.back() = static_cast<std::uint8_t>(path.back() | action << 2 * (step % 4));
}

/// Returns the action of step number `step`, kNoAction beyond the path's end.
inline std::uint8_t action_at(std::span<const std::uint8_t> path, std::size_t step) {
  return static_cast<std::uint8_t>(step / 4 < path.size() ? path[step / 4] >> 2 * (step % 4) & 3 : +kNoAction);
}

}  // namespace citylearn
