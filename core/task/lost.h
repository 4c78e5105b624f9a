// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

namespace citylearn {

/// Probability of being lost above which an agent says so.
constexpr double kMaxLost = 0.7;

/// Probability of being lost up to which an agent took its likeliest place for the right one.
constexpr double kMaxSure = 0.5;

/// Returns whether no action leads from the likeliest place before a step to the one after it, even if it slipped.
constexpr bool leaps(std::uint32_t before, std::uint32_t now) {
  constexpr std::uint32_t kReach = 3;  // two places by a slip, and one within which a belief is right
  return (before > now ? before - now : now - before) > kReach;
}

/// Returns the least probability of being lost since the likeliest place leapt, after a step: what it was before, the
/// likeliest places (msg::Belief) before and after, and the probability of being lost now. 1 at an episode's start.
constexpr double least_lost(double least_before, std::uint32_t before, std::uint32_t now, double lost) {
  return leaps(before, now) ? lost : std::min(least_before, lost);
}

/// Returns whether an agent says that it is lost after a step. It is lost now, or it has been: its likeliest place
/// leapt, and since the leap before it was sure of it. An agent that was carried away doubts for some steps, then leaps
/// to where it is. One that never was sure has only found itself. Parameters are those of least_lost().
constexpr bool says_lost(double least_before, std::uint32_t before, std::uint32_t now, double lost, double bound) {
  return lost > bound || (least_before <= std::min(kMaxSure, bound) && leaps(before, now));
}

}  // namespace citylearn
