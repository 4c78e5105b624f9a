// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "core/task/state_map.h"
#include "sparse_filter.h"

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

/// Returns by action the share of a belief over the states of `map` for which it leads nearer to the goal.
template <class S>
std::array<S, kActions> votes(const SparseStep<S>& step, const DistanceField& distance, const StateMap& map) {
  std::array<S, kActions> votes{};
  for (std::size_t i = 0; i < step.places.size(); ++i) {
    if (step.shares[i] <= 0) continue;
    const int here = distance(step.places[i]);
    for (std::uint8_t action = 0; action < kActions; ++action)
      if (const int to = map.next(step.places[i], action); to >= 0 && distance(to) < here)
        votes[action] += step.shares[i];
  }
  return votes;
}

/// Sees to it that a belief that is torn does not turn for ever: an agent that has turned as often in a row as it takes
/// to face each heading of a place, and at least 4 times, must go forward where that is allowed.
class TurnGuard {
 public:
  explicit TurnGuard(const StateMap& map) {
    std::vector<int> headings(static_cast<std::size_t>(map.places()));
    for (int state = 0; state < map.states(); ++state) ++headings[static_cast<std::size_t>(map.place(state))];
    most_ = std::max(4, *std::max_element(headings.begin(), headings.end()) - 1);
  }
  /// Returns the turns in a row after a step. `previous`: kNoAction at an episode's start.
  static int after(int turns, std::uint8_t previous) { return previous == kLeft || previous == kRight ? turns + 1 : 0; }
  bool must_go(int turns, std::uint8_t allowed) const { return turns >= most_ && (allowed >> kForward & 1); }

 private:
  int most_;
};

}  // namespace citylearn
