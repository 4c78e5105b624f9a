// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/plugin/registry.h"
#include "core/task/action.h"
#include "policy_service/network/agents/learned_motion.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn {

/// Definitions that place_filter and its exporter share.
namespace place_filter {

enum { kEvidence, kTempering, kNearness, kTurning, kDirectness, kScalars };  ///< rows of filter.scalars
constexpr int kScales = 8;                                                   ///< masses by distance, on each side

template <class S>
struct Sides {
  S before = 0, after = 0;  ///< of the goal
};

/// What filter.scalars says.
template <class S>
struct Scalars {
  S evidence, tempering, nearness, turning, directness;

  /// Returns the weights of the sides after an action.
  Sides<S> turnings(std::uint8_t previous) const {
    return {previous == kPrevious ? turning : S(1), previous == kNext ? turning : S(1)};
  }
};

/// Inputs of the head: 2 S(before), 2 S(after), masses by distance before and after the goal, these.
enum { kSharpness = 2 + 2 * kScales, kMask, kInputs = kMask + 2 * kActions };
constexpr int kWayOn = 0, kStaying = 1, kStateValue = 2, kOutputs = 3;  ///< outputs of the head, for each direction

/// Returns, for each of the head's inputs, which one takes its place when the route is seen from the other end.
inline std::vector<int> mirrored_inputs(int inputs) {
  std::vector<int> mirror(static_cast<std::size_t>(inputs));
  for (int input = 0; input < inputs; ++input) mirror[static_cast<std::size_t>(input)] = input;
  const auto swap = [&](int one, int other) {
    mirror[static_cast<std::size_t>(one)] = other;
    mirror[static_cast<std::size_t>(other)] = one;
  };
  swap(0, 1);
  for (int scale = 0; scale < kScales; ++scale) swap(2 + scale, 2 + kScales + scale);
  for (const int first : {kMask + 0, kMask + kActions}) swap(first + kNext, first + kPrevious);
  return mirror;
}

// Scores that no evidence outweighs: it adds up to less than s (1 + log(1 + h N) / h), 1000 on the longest routes.
constexpr float kExclusion = 1000, kNever = -100 * kExclusion;

}  // namespace place_filter

/// Takes `exclusion` from the scores of places where an agent on its way cannot be: the goal, an end of the route's
/// `frames` places that the actions allowed do not show, and all but the end that they do.
template <class Score>
void exclude(std::ptrdiff_t goal, std::ptrdiff_t frames, std::uint8_t allowed, typename Score::Scalar exclusion,
             Score& score) {
  const auto only = [&](std::ptrdiff_t end, bool here) {
    if (here) score.array() -= exclusion;
    score(end) += here ? exclusion : -exclusion;
  };
  only(0, !(allowed >> kPrevious & 1));
  only(frames - 1, !(allowed >> kNext & 1));
  score(goal) -= exclusion;
}

}  // namespace citylearn
