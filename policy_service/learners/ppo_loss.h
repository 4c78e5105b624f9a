#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/messages.h"
#include "policy_service/agent_network.h"

namespace citylearn {

/// Weights of the loss's parts.
struct PpoWeights {
  double clip = 0.2;      ///< the ratio of probabilities is clipped to 1 - clip .. 1 + clip
  double value_clip = 0;  ///< a value's change is clipped to this; 0 = it is not
  double value = 0.5;
  double entropy = 0;
  double localisation = 0;  ///< of telling one's place
  double orientation = 0;   ///< of telling the way to the goal
};

/// What was done, column by column of the heads.
template <class S>
struct PpoSamples {
  std::vector<std::uint8_t> action;
  std::vector<S> log_probability, advantage, value, target;  ///< as collected
  void resize(std::size_t count) {
    action.resize(count);
    for (std::vector<S>* part : {&log_probability, &advantage, &value, &target}) part->resize(count);
  }
};

/// Sums over samples.
struct PpoSums {
  double loss = 0, policy = 0, value = 0, entropy = 0, divergence = 0, clipped = 0, localisation = 0, orientation = 0;
  PpoSums& operator+=(const PpoSums& other) {
    loss += other.loss, policy += other.policy, value += other.value, entropy += other.entropy;
    divergence += other.divergence, clipped += other.clipped;
    localisation += other.localisation, orientation += other.orientation;
    return *this;
  }
};

/// The clipped surrogate loss (Schulman et al., 2017, eq. 9), with squared error of values, entropy bonus and, where
/// the heads have them, squared errors of the agent's whereabouts on a route of `frames` places (N). `derivative` gets
/// the derivatives, each times `share` (one over the number of samples of the whole minibatch).
template <class S>
PpoSums ppo_loss(const PpoWeights& weights, const PpoSamples<S>& samples, const NetworkInputs<S>& inputs, int frames,
                 const Heads<S>& heads, S share, Heads<S>& derivative) {
  PpoSums sums;
  const std::ptrdiff_t columns = heads.logits.cols();
  derivative.logits.resize(kActions, columns);
  derivative.values.resize(1, columns);
  derivative.whereabouts.resize(heads.whereabouts.rows(), heads.whereabouts.cols());
  const S low = static_cast<S>(1 - weights.clip), high = static_cast<S>(1 + weights.clip);
  for (std::ptrdiff_t column = 0; column < columns; ++column) {
    const std::size_t index = static_cast<std::size_t>(column);
    const auto logits = heads.logits.col(column);
    const S largest = logits.maxCoeff();
    S sum = 0, entropy = 0;
    for (int i = 0; i < kActions; ++i) sum += std::exp(logits(i) - largest);
    const S log_sum = largest + std::log(sum);
    std::array<S, kActions> log_p, p;
    for (std::size_t i = 0; i < kActions; ++i) {
      log_p[i] = logits(static_cast<std::ptrdiff_t>(i)) - log_sum;
      p[i] = std::exp(log_p[i]);
      entropy -= p[i] * log_p[i];
    }

    const std::uint8_t action = samples.action[index];
    const S advantage = samples.advantage[index], log_ratio = log_p[action] - samples.log_probability[index];
    const S ratio = std::exp(log_ratio), clipped_ratio = std::clamp(ratio, low, high);
    const bool clipped =
        clipped_ratio * advantage < ratio * advantage;  // then the minimum does not depend on the ratio
    const S by_log_p = clipped ? S(0) : -advantage * ratio;
    auto by_logits = derivative.logits.col(column);
    for (std::size_t i = 0; i < kActions; ++i) {
      const S by_policy = by_log_p * (static_cast<S>(i == action) - p[i]);
      const S by_entropy = static_cast<S>(weights.entropy) * p[i] * (log_p[i] + entropy);
      by_logits(static_cast<std::ptrdiff_t>(i)) = share * (by_policy + by_entropy);
    }

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
    sums.entropy += static_cast<double>(entropy);
    sums.divergence += static_cast<double>(ratio - S(1) - log_ratio);
    sums.clipped += ratio < low || ratio > high ? 1 : 0;
  }
  for (std::ptrdiff_t column = 0; column < heads.whereabouts.cols(); ++column) {
    const std::size_t index = static_cast<std::size_t>(column);
    const std::array<S, 2> truth = whereabouts<S>(inputs.position[index], inputs.goal[index], frames);
    const S place = heads.whereabouts(0, column) - truth[0], way = heads.whereabouts(1, column) - truth[1];
    derivative.whereabouts(0, column) = static_cast<S>(2 * weights.localisation) * place * share;
    derivative.whereabouts(1, column) = static_cast<S>(2 * weights.orientation) * way * share;
    sums.localisation += static_cast<double>(place * place);
    sums.orientation += static_cast<double>(way * way);
  }
  sums.loss = sums.policy + weights.value * sums.value - weights.entropy * sums.entropy +
              weights.localisation * sums.localisation + weights.orientation * sums.orientation;
  return sums;
}

}  // namespace citylearn
