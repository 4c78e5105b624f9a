// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>

#include "policy_service/learning/learner.h"
#include "policy_service/rollout/worker.h"

namespace citylearn {

/// Adam (Kingma & Ba, 2015) on the sum of two gradients, scaled down to a length where it is longer. Each of two
/// threads has half of the parameters: what comes out does not depend on timing.
class Adam {
 public:
  struct Options {
    double epsilon = 1e-5;
    double gradient_norm = 0.5;  ///< the gradient's largest length
  };

  Adam(std::ptrdiff_t parameters, const Options& options) : options_(options) {
    first_moment_.setZero(parameters);
    second_moment_.setZero(parameters);
  }

  /// One step. `gradient` becomes the sum of both. Returns its length before it was scaled down. One that is not finite
  /// changes nothing: it would stay in the parameters for ever.
  double step(double learning_rate, Vector<float>& gradient, const Vector<float>& other, Vector<float>& parameters,
              Worker& worker) {
    const std::ptrdiff_t half_size = parameters.size() / 2;
    const auto range = [&](int which, auto& all) {
      return which == 0 ? all.segment(0, half_size) : all.segment(half_size, all.size() - half_size);
    };
    std::array<double, 2> squares;
    const auto add = [&](int which) {
      auto sum = range(which, gradient);
      sum += range(which, other);
      squares[static_cast<std::size_t>(which)] = static_cast<double>(sum.squaredNorm());
    };
    worker.both(std::cref(add));
    const double norm = std::sqrt(squares[0] + squares[1]);
    if (!std::isfinite(norm)) return norm;
    ++steps_;
    const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(steps_));
    const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(steps_));
    const float scale = static_cast<float>(std::min(1.0, options_.gradient_norm / (norm + 1e-12)));
    const float rate = static_cast<float>(learning_rate / correction1);
    const float spread = static_cast<float>(1 / std::sqrt(correction2)), epsilon = static_cast<float>(options_.epsilon);
    const auto descend = [&](int which) {
      const auto scaled = range(which, gradient).array() * scale;
      auto first = range(which, first_moment_).array(), second = range(which, second_moment_).array();
      first = static_cast<float>(kBeta1) * first + static_cast<float>(1 - kBeta1) * scaled;
      second = static_cast<float>(kBeta2) * second + static_cast<float>(1 - kBeta2) * scaled.square();
      range(which, parameters).array() -= rate * first / (second.sqrt() * spread + epsilon);
    };
    worker.both(std::cref(descend));
    return norm;
  }

  void save(LearnerState& state) const {
    state.counters["adam_steps"] = steps_;
    state.tensors["adam.first"] = first_moment_;
    state.tensors["adam.second"] = second_moment_;
  }
  /// `state` has what save() wrote, of the same size.
  void load(const LearnerState& state) {
    steps_ = state.counters.at("adam_steps");
    first_moment_ = state.tensors.at("adam.first");
    second_moment_ = state.tensors.at("adam.second");
  }

 private:
  static constexpr double kBeta1 = 0.9, kBeta2 = 0.999;
  Options options_;
  Vector<float> first_moment_, second_moment_;
  std::uint64_t steps_ = 0;
};

}  // namespace citylearn
