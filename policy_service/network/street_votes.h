// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "core/task/state_map.h"
#include "policy_service/network/sparse_filter.h"

namespace citylearn {

/// The actions on streets in the order in which one of equals is preferred.
inline constexpr std::array<std::uint8_t, kActions> kStreetActions{kForward, kLeft, kRight};

/// Returns the action with which a shortest way to a goal begins; kNoAction at the goal and where no way leads there.
inline std::uint8_t way_to(const DistanceField& distance, const StateMap& map, int state) {
  const int left = distance.reaches(state) ? distance(state) : 0;
  for (const std::uint8_t action : kStreetActions)
    if (const int to = map.next(state, action); left > 0 && to >= 0 && distance(to) < left) return action;
  return kNoAction;
}

/// Returns `action` if it is allowed, else one that is.
inline std::uint8_t allowed_or_other(std::uint8_t action, std::uint8_t allowed) {
  if (action < kActions && allowed >> action & 1) return action;
  for (const std::uint8_t other : kStreetActions)
    if (allowed >> other & 1) return other;
  return kForward;
}

/// Returns by action the share of a belief over the states of `map` for which it is the way to the goal.
template <class S>
std::array<S, kActions> votes(const SparseStep<S>& step, const DistanceField& distance, const StateMap& map) {
  std::array<S, kActions> votes{};
  for (std::size_t i = 0; i < step.places.size(); ++i) {
    if (step.shares[i] == 0) continue;
    const std::uint8_t action = way_to(distance, map, step.places[i]);
    if (action != kNoAction) votes[action] += step.shares[i];
  }
  return votes;
}

}  // namespace citylearn
