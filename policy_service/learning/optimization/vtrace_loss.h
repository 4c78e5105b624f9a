// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "policy_service/learning/optimization/loss_parts.h"
#include "policy_service/rollout/rollout.h"

namespace citylearn {

/// The limits of V-trace's corrections.
struct VtraceLimits {
  double gamma = 0.99;  ///< discount a step
  double lambda = 1;    ///< 1 as in the paper; less trusts the values more, as in generalised advantage estimation
  double rho = 1;       ///< a step's importance weight is cut off here: which policy is valued
  double c = 1;         ///< and the weight of what follows it here: how fast
};

/// The actions of B agents in T steps under any policy, column by column of the heads (t * B + b).
template <class S>
struct TrajectoryBatch {
  std::vector<std::uint8_t> action;  ///< kNoAction where the column only shows what follows the last action
  std::vector<std::uint8_t> ended;   ///< Rollout::Ended by the action
  std::vector<S> log_probability;    ///< of the action when it was taken
  std::vector<S> reward;             ///< of the action
  std::vector<S> final_value;        ///< where truncated: value of what the episode would have gone on with
  std::vector<S> target;             ///< v_s, see vtrace()
  std::vector<S> advantage;          ///< of the action
  std::vector<S> weight;             ///< rho_s
  void resize(std::size_t count) {
    action.resize(count);
    ended.resize(count);
    for (std::vector<S>* part : {&log_probability, &reward, &final_value, &target, &advantage, &weight})
      part->resize(count);
  }
};

/// V-trace targets (Espeholt et al., IMPALA, 2018, eq. 1 in the recursive form of remark 1), and what section 4.2
/// weighs the policy's gradient with: rho_s and the advantage r_s + gamma v_(s+1) - V(x_s). With lambda < 1 both
/// v_(s+1) and the trace are mixed with the values, so that on-policy, with rho and c at least 1, the advantages are
/// generalised advantage estimates. `heads` are those of the policy to be improved, for `agents` (B) agents; each one's
/// last column has no action.
template <class S>
void vtrace(const VtraceLimits& limits, const Heads<S>& heads, int agents, TrajectoryBatch<S>& trajectories) {
  const std::ptrdiff_t columns = heads.logits.cols(), stride = agents;
  const S gamma = static_cast<S>(limits.gamma), lambda = static_cast<S>(limits.lambda);
  for (std::ptrdiff_t agent = 0; agent < stride; ++agent) {
    S next_value = 0, next_gain = 0;  // V(x_(s+1)), v_(s+1) - V(x_(s+1))
    for (std::ptrdiff_t column = columns - stride + agent; column >= 0; column -= stride) {
      const std::size_t index = static_cast<std::size_t>(column);
      const S value = heads.values(0, column);
      trajectories.target[index] = value;
      trajectories.advantage[index] = trajectories.weight[index] = 0;
      if (trajectories.action[index] == kNoAction) {
        next_value = value;
        next_gain = 0;
        continue;
      }
      if (trajectories.ended[index] != Rollout::kGoesOn) {
        next_value = trajectories.ended[index] == Rollout::kTruncated ? trajectories.final_value[index] : S(0);
        next_gain = 0;
      }
      const ActionOdds<S> odds(heads.logits.col(column));
      const S ratio = std::exp(odds.log_ratio(trajectories.action[index], trajectories.log_probability[index]));
      const S rho = std::min(static_cast<S>(limits.rho), ratio), c = lambda * std::min(static_cast<S>(limits.c), ratio);
      const S error = trajectories.reward[index] + gamma * next_value - value;
      trajectories.weight[index] = rho;
      trajectories.advantage[index] = error + gamma * lambda * next_gain;
      next_gain = rho * error + gamma * c * next_gain;
      trajectories.target[index] = value + next_gain;
      next_value = value;
    }
  }
}

/// The actor-critic loss of section 4.2: -rho_s log pi(a_s | x_s) advantage_s times `scale`, squared error of values,
/// entropy bonus and, where the heads have them, squared errors of the auxiliary targets on a route of `frames`
/// places (N). Targets, advantages and rho_s are taken as constants. `derivative` gets the derivatives, each times
/// `share` (one over the number of samples of the whole minibatch).
template <class S>
LossSums vtrace_loss(const LossWeights& weights, const VtraceLimits& limits, const TrajectoryBatch<S>& trajectories,
                     const NetworkInputs<S>& inputs, int frames, const Heads<S>& heads, S scale, S share,
                     Heads<S>& derivative) {
  LossSums sums;
  const std::ptrdiff_t columns = heads.logits.cols();
  derivative.logits.setZero(kActions, columns);
  derivative.values.setZero(1, columns);
  for (std::ptrdiff_t column = 0; column < columns; ++column) {
    const std::size_t index = static_cast<std::size_t>(column);
    const std::uint8_t action = trajectories.action[index];
    if (action == kNoAction) continue;
    const ActionOdds<S> odds(heads.logits.col(column));
    const S gain = scale * trajectories.weight[index] * trajectories.advantage[index];
    odds.differentiate(action, -gain, weights.entropy, share, derivative.logits.col(column));
    const S error = heads.values(0, column) - trajectories.target[index];
    derivative.values(0, column) = static_cast<S>(weights.value) * error * share;

    const S log_ratio = odds.log_ratio(action, trajectories.log_probability[index]), ratio = std::exp(log_ratio);
    sums.policy -= static_cast<double>(gain * odds.log_p[action]);
    sums.value += 0.5 * static_cast<double>(error * error);
    sums.entropy += static_cast<double>(odds.entropy);
    sums.approx_kl += static_cast<double>(ratio - S(1) - log_ratio);
    sums.clipped += ratio > S(1.001) * static_cast<S>(limits.rho) ? 1 : 0;
  }
  auxiliary_loss(weights, inputs, frames, heads, share, derivative, sums);
  add_up(weights, sums);
  return sums;
}

}  // namespace citylearn
