// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <span>

#include "policy_service/rollout/rollout.h"

namespace citylearn {

/// Estimates the advantages of all rollouts (see Rollout::estimate_advantages); with `normalise` they then have mean 0
/// and deviation 1 over all of them together.
inline void estimate_advantages(std::span<Rollout* const> rollouts, double gamma, double lambda, bool normalise) {
  double sum = 0, squares = 0, count = 0;
  for (Rollout* rollout : rollouts) {
    rollout->estimate_advantages(gamma, lambda);
    for (float advantage : rollout->advantage) {
      sum += advantage;
      squares += static_cast<double>(advantage) * advantage;
    }
    count += static_cast<double>(rollout->advantage.size());
  }
  if (!normalise) return;
  const double mean = sum / count, deviation = std::sqrt(std::max(0.0, squares / count - mean * mean));
  for (Rollout* rollout : rollouts)
    for (float& advantage : rollout->advantage) advantage = static_cast<float>((advantage - mean) / (deviation + 1e-8));
}

}  // namespace citylearn
