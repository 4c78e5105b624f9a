// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <vector>

#include "policy_service/network/agents/place_filter.h"
#include "policy_service/network/belief/sparse_filter.h"

namespace citylearn::place_filter {

/// What a sparse belief over a line tells the head, as place_filter.cc says it, seen from the goal.
template <class S>
class SparseInputs {
 public:
  using Sides = place_filter::Sides<S>;

  /// Weighs places by 1 / distance^nearness.
  void set_nearness(S nearness, int places) {
    if (nearness == nearness_ && weights_.size() == places) return;
    nearness_ = nearness;
    logs_ = Vector<S>::LinSpaced(places, S(1), static_cast<S>(places)).array().log();
    weights_ = (-nearness * logs_).array().exp();
    for (Vector<double>* sums : {&weight_sums_, &log_sums_}) sums->setZero(places + 1);
    for (std::ptrdiff_t i = 0; i < places; ++i) {
      weight_sums_(i + 1) = weight_sums_(i) + static_cast<double>(weights_(i));
      log_sums_(i + 1) = log_sums_(i) + static_cast<double>(weights_(i) * logs_(i));
    }
  }

  /// Sets the inputs that depend on the belief. Returns the weighed belief on both sides, each times its `turning`.
  template <class Inputs>
  Sides read(const SparseStep<S>& step, int frames, const Sides& turning, Inputs&& inputs) const {
    const S even = step.elsewhere / static_cast<S>(frames);
    Sides sides{even * sum(weight_sums_, step.goal), even * sum(weight_sums_, frames - 1 - step.goal)};
    each_scale(step.goal, frames, [&](int input, int count) { inputs(input) = 2 * even * static_cast<S>(count); });
    S sharpness = 0;
    each_place(step, [&](std::size_t i, bool after, std::ptrdiff_t distance, int scale) {
      (after ? sides.after : sides.before) += step.shares[i] * weights_(distance);
      inputs(scale) += 2 * step.shares[i];
      sharpness += step.shares[i] * step.shares[i];
    });
    inputs(kSharpness) = sharpness;
    sides.before *= turning.before;
    sides.after *= turning.after;
    inputs(0) = 2 * sides.before / all(sides);
    inputs(1) = 2 * sides.after / all(sides);
    return sides;
  }

  struct Derivatives {
    S nearness = 0;
    Sides sides = {};  ///< by what read() returned
  };
  /// Returns derivatives by the nearness and by `sides`, which read() returned.
  template <class ByInputs>
  Derivatives unread(const SparseStep<S>& step, int frames, const Sides& turning, const Sides& sides,
                     const ByInputs& by_inputs) const {
    const S before = 2 * by_inputs(0), after = 2 * by_inputs(1);
    const S mean = (before * sides.before + after * sides.after) / all(sides);
    Derivatives out{0, {(before - mean) / all(sides), (after - mean) / all(sides)}};
    const Sides by{out.sides.before * turning.before, out.sides.after * turning.after};
    out.nearness = -step.elsewhere / static_cast<S>(frames) *
                   (by.before * sum(log_sums_, step.goal) + by.after * sum(log_sums_, frames - 1 - step.goal));
    each_place(step, [&](std::size_t i, bool is_after, std::ptrdiff_t distance, int) {
      out.nearness -= step.shares[i] * (is_after ? by.after : by.before) * weights_(distance) * logs_(distance);
    });
    return out;
  }

 private:
  static S all(const Sides& sides) { return sides.before + sides.after + std::numeric_limits<S>::min(); }
  static S sum(const Vector<double>& sums, int count) { return static_cast<S>(sums(count)); }

  /// Calls use(index, after the goal, distance - 1, input of the scale) for each place but the goal.
  template <class Use>
  static void each_place(const SparseStep<S>& step, Use&& use) {
    for (std::size_t i = 0; i < step.places.size(); ++i) {
      const int ahead = step.places[i] - step.goal;
      if (ahead == 0) continue;
      const auto distance = static_cast<unsigned>(ahead > 0 ? ahead : -ahead);
      const int scale = std::min(static_cast<int>(std::bit_width(distance)), kScales) - 1;
      use(i, ahead > 0, static_cast<std::ptrdiff_t>(distance) - 1, 2 + scale + (ahead > 0 ? kScales : 0));
    }
  }
  /// Calls use(input, number of places) for each mass by distance.
  template <class Use>
  static void each_scale(int goal, int frames, Use&& use) {
    for (const bool after : {false, true})
      for (int scale = 0; scale < kScales; ++scale) {
        const int beyond = after ? frames - 1 - goal : goal, near = 1 << scale;
        const int far = scale + 1 < kScales ? 2 * near - 1 : beyond;
        use(2 + scale + (after ? kScales : 0), std::max(0, std::min(far, beyond) - near + 1));
      }
  }

  S nearness_ = 0;
  Vector<S> logs_, weights_;               // N, of places at distances from 1 on to the goal
  Vector<double> weight_sums_, log_sums_;  // N + 1, of the nearest places' weights, and of these times the logarithm
};

}  // namespace citylearn::place_filter
