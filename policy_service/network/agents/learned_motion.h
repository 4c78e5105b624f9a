// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

#include "core/plugin/registry.h"
#include "core/task/state_map.h"
#include "policy_service/network/belief/motion.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn::place_filter {

/// Returns the probability that a learned tensor, filter.slip or filter.kidnap, holds.
template <class S>
S learned_probability(S stored) {
  return 1 / (1 + std::exp(-static_cast<S>(kStretch) * stored));
}

inline bool learns_slip(const Parameters& parameters) { return parameters["slip"] < 0; }
inline bool learns_kidnap(const Parameters& parameters) { return learns_slip(parameters) && parameters["kidnap"] < 0; }

/// Returns the motion that the parameters tell of; what is learned is that of nobody who ever slips or is kidnapped.
template <class S>
Motion<S> told_motion(const Parameters& parameters) {
  const double least = learns_slip(parameters) ? kLeastKidnap : 0;
  return {std::max(parameters["slip"], 0.0), std::max(parameters["kidnap"], least),
          static_cast<TemperingLimit>(parameters.integer(kSlipsLimitTempering))};
}

constexpr double kFirstSlip = 0.01, kFirstKidnap = 1e-4;  ///< what is learned, before anything is experienced

/// Adds to the gradients by the tensors filter.slip and filter.kidnap, null where these are told, for the likeliest
/// motion by where actions led.
template <class S>
void add_model_gradient(const StateMap& map, const Motion<S>& motion, const NetworkInputs<S>& inputs, S* slip,
                        S* kidnap) {
  if (!slip) return;
  const S p = motion.slip(), k = motion.kidnap(), anywhere = 1 / static_cast<S>(inputs.frames);
  const std::size_t agents = static_cast<std::size_t>(inputs.agents), columns = inputs.goal.size();
  S by_slip = 0, by_kidnap = 0;  // of the sum of -log P(where an action led)
  for (std::size_t column = agents; column < columns; ++column) {
    if (inputs.first[column]) continue;
    const int here = inputs.position[column - agents], goal = inputs.goal[column - agents];
    const auto led = [&](int times) { return map.after(here, inputs.previous_action[column], times); };
    // Of steps that can end the episode only those that did not are seen here, too many of them slips.
    if (map.place(led(1)) == goal || map.place(led(2)) == goal) continue;
    const int there = inputs.position[column];
    const auto leads = [&](int times) { return led(times) == there ? S(1) : S(0); };
    const S once = leads(1), slipped = (leads(0) + leads(2)) / 2;
    const S walked = (1 - p) * once + p * slipped, likelihood = (1 - k) * walked + k * anywhere;
    if (!(likelihood > 0)) continue;
    by_slip += (1 - k) * (once - slipped) / likelihood;
    by_kidnap += (walked - anywhere) / likelihood;
  }
  const auto learn = [&](S* gradient, S value, S by) {
    if (gradient) *gradient += static_cast<S>(kStretch) * value * (1 - value) * by / static_cast<S>(columns);
  };
  learn(slip, p, by_slip);
  learn(kidnap, k, by_kidnap);
}

}  // namespace citylearn::place_filter
