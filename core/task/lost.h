// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

namespace citylearn {

/// Probability of being lost above which an agent says so.
constexpr double kMaxLost = 0.7;

/// Returns whether an agent says that it is lost, by its beliefs before and after a step: by the likeliest place and
/// the probability of being lost of each (msg::Belief). It is lost now, or it has been: it was sure of a place from
/// which no action leads to the one that is likeliest now, even if it slipped. An agent that was carried away and
/// recognises at once where it is says so by this alone. `lost_before`: 1 at an episode's start.
constexpr bool says_lost(std::uint32_t before, double lost_before, std::uint32_t now, double lost, double bound) {
  constexpr std::uint32_t kReach = 3;  // two places by a slip, and one within which a belief is right
  return lost > bound || (lost_before <= bound && (before > now ? before - now : now - before) > kReach);
}

}  // namespace citylearn
