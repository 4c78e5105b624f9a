// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "policy_service/learning/optimization/loss_parts.h"

namespace citylearn {

/// Weights of the loss's parts.
struct PpoWeights : LossWeights {
  double clip = 0.2;      ///< the ratio of probabilities is clipped to 1 - clip .. 1 + clip
  double value_clip = 0;  ///< a value's change is clipped to this; 0 = it is not
};

/// The actions that were done, column by column of the heads.
template <class S>
struct PpoSamples {
  std::vector<std::uint8_t> action;
  std::vector<S> log_probability, advantage, value, target;  ///< as collected
  void resize(std::size_t count) {
    action.resize(count);
    for (std::vector<S>* part : {&log_probability, &advantage, &value, &target}) part->resize(count);
  }
};

/// The clipped surrogate loss (Schulman et al., 2017, eq. 9), with squared error of values, entropy bonus and, where
/// the heads have them, squared errors of the auxiliary targets on a route of `frames` places (N). `derivative` gets
/// the derivatives, each times `share` (one over the number of samples of the whole minibatch).
template <class S>
LossSums ppo_loss(const PpoWeights& weights, const PpoSamples<S>& samples, const NetworkInputs<S>& inputs, int frames,
                  const Heads<S>& heads, S share, Heads<S>& derivative) {
  LossSums sums;
  const std::ptrdiff_t columns = heads.logits.cols();
  derivative.logits.resize(kActions, columns);
  derivative.values.resize(1, columns);
  const S low = static_cast<S>(1 - weights.clip), high = static_cast<S>(1 + weights.clip);
  for (std::ptrdiff_t column = 0; column < columns; ++column) {
    const std::size_t index = static_cast<std::size_t>(column);
    const ActionOdds<S> odds(heads.logits.col(column));
    const std::uint8_t action = samples.action[index];
    const S advantage = samples.advantage[index], log_ratio = odds.log_ratio(action, samples.log_probability[index]);
    const S ratio = std::exp(log_ratio), clipped_ratio = std::clamp(ratio, low, high);
    const bool clipped =
        clipped_ratio * advantage < ratio * advantage;  // then the minimum does not depend on the ratio
    const S by_log_p = clipped ? S(0) : -advantage * ratio;
    odds.differentiate(action, by_log_p, weights.entropy, share, derivative.logits.col(column));

    const S value = heads.values(0, column), target = samples.target[index];
    S error = value - target, by_value = error;
    if (weights.value_clip > 0) {
      const S reach = static_cast<S>(weights.value_clip);
      const S change = value - samples.value[index];
      const S held = samples.value[index] + std::clamp(change, -reach, reach) - target;
      if (std::abs(change) > reach && std::abs(held) > std::abs(error)) error = held, by_value = 0;
    }
    derivative.values(0, column) = static_cast<S>(weights.value) * by_value * share;

    sums.policy -= static_cast<double>(std::min(ratio * advantage, clipped_ratio * advantage));
    sums.value += 0.5 * static_cast<double>(error * error);
    sums.entropy += static_cast<double>(odds.entropy);
    sums.approx_kl += static_cast<double>(ratio - S(1) - log_ratio);
    sums.clipped += ratio < low || ratio > high ? 1 : 0;
  }
  auxiliary_loss(weights, inputs, frames, heads, share, derivative, sums);
  add_up(weights, sums);
  return sums;
}

}  // namespace citylearn
