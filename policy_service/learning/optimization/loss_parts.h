// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "core/task/action.h"
#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Weights of the parts that every loss has beside the policy's.
struct LossWeights {
  double value = 0.5;
  double entropy = 0;
  double localisation = 0;  ///< of telling one's place
  double orientation = 0;   ///< of telling the way to the goal
};

/// Sums over samples.
struct LossSums {
  double loss = 0, policy = 0, value = 0, entropy = 0, approx_kl = 0, clipped = 0, localisation = 0, orientation = 0;
  LossSums& operator+=(const LossSums& other) {
    loss += other.loss, policy += other.policy, value += other.value, entropy += other.entropy;
    approx_kl += other.approx_kl, clipped += other.clipped;
    localisation += other.localisation, orientation += other.orientation;
    return *this;
  }
};

/// Probabilities of the actions.
template <class S>
struct ActionOdds {
  std::array<S, kActions> log_p, p;
  S entropy = 0;  ///< nats

  explicit ActionOdds(const Eigen::Ref<const Eigen::Matrix<S, kActions, 1>>& logits) {
    const S largest = logits.maxCoeff();
    S sum = 0;
    for (int i = 0; i < kActions; ++i) sum += std::exp(logits(i) - largest);
    const S log_sum = largest + std::log(sum);
    for (std::size_t i = 0; i < kActions; ++i) {
      log_p[i] = logits(static_cast<std::ptrdiff_t>(i)) - log_sum;
      p[i] = std::exp(log_p[i]);
      entropy -= p[i] * log_p[i];
    }
  }
  /// log(now / when it was taken), held within +-20: its exponential stays a number, however stale the sample.
  S log_ratio(std::uint8_t action, S log_probability) const {
    return std::clamp(log_p[action] - log_probability, S(-20), S(20));
  }
  /// Derivatives by the logits of a loss with this derivative by the action's log-probability and that weight of an
  /// entropy bonus, times `share`.
  template <class Column>
  void differentiate(std::uint8_t action, S by_log_p, double entropy_weight, S share, Column&& by_logits) const {
    for (std::size_t i = 0; i < kActions; ++i) {
      const S by_policy = by_log_p * (static_cast<S>(i == action) - p[i]);
      const S by_entropy = static_cast<S>(entropy_weight) * p[i] * (log_p[i] + entropy);
      by_logits(static_cast<std::ptrdiff_t>(i)) = share * (by_policy + by_entropy);
    }
  }
};

/// Adds squared errors of the auxiliary targets on a route of `frames` places (N), where the heads have them.
template <class S>
void auxiliary_loss(const LossWeights& weights, const NetworkInputs<S>& inputs, int frames, const Heads<S>& heads,
                    S share, Heads<S>& derivative, LossSums& sums) {
  derivative.auxiliary.resize(heads.auxiliary.rows(), heads.auxiliary.cols());
  for (std::ptrdiff_t column = 0; column < heads.auxiliary.cols(); ++column) {
    const std::size_t index = static_cast<std::size_t>(column);
    const std::array<S, 2> truth = auxiliary_targets<S>(inputs.position[index], inputs.goal[index], frames);
    const S place = heads.auxiliary(0, column) - truth[0], way = heads.auxiliary(1, column) - truth[1];
    derivative.auxiliary(0, column) = static_cast<S>(2 * weights.localisation) * place * share;
    derivative.auxiliary(1, column) = static_cast<S>(2 * weights.orientation) * way * share;
    sums.localisation += static_cast<double>(place * place);
    sums.orientation += static_cast<double>(way * way);
  }
}

/// The whole loss from its parts.
inline void add_up(const LossWeights& weights, LossSums& sums) {
  sums.loss = sums.policy + weights.value * sums.value - weights.entropy * sums.entropy +
              weights.localisation * sums.localisation + weights.orientation * sums.orientation;
}

}  // namespace citylearn
