// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>

namespace citylearn {

/// Returns one episode's success weighted by path length (Anderson et al., 2018, "On Evaluation of Embodied Navigation
/// Agents", section 2): 0 when it was not completed, else the shortest path over the path taken, at most 1. An episode
/// whose start is its goal counts 1.
inline double spl_of(bool completed, double shortest, double steps) {
  if (!completed) return 0;
  const double longer = std::max(shortest, steps);
  return longer > 0 ? shortest / longer : 1;
}

/// Returns the path taken over the shortest one, for a completed episode.
inline double excess_of(double shortest, double steps) { return shortest > 0 ? steps / shortest : 1; }

}  // namespace citylearn
