// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numeric>
#include <span>
#include <vector>

#include "policy_service/learning/learner.h"
#include "policy_service/rollout/worker_pool.h"

namespace citylearn {

/// Adam (Kingma & Ba, 2015) on the sum of gradients, scaled down to a length where it is longer. The parameters are
/// divided into as many parts as there are gradients, for as many threads: what comes out does not depend on timing.
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

  /// Makes one step. The first of `gradients` becomes their sum, added in their order. Returns its length before it was
  /// scaled down. One that is not finite changes nothing: it would stay in the parameters for ever.
  double step(double learning_rate, std::span<Vector<float>> gradients, Vector<float>& parameters,
              WorkerPool& workers) {
    const auto parts = static_cast<std::ptrdiff_t>(gradients.size());
    const auto range = [&](int part, auto& all) {
      const std::ptrdiff_t begin = part * all.size() / parts, end = (part + 1) * all.size() / parts;
      return all.segment(begin, end - begin);
    };
    squares_.resize(gradients.size());
    const auto add = [&](int part) {
      auto sum = range(part, gradients[0]);
      for (const Vector<float>& other : gradients.subspan(1)) sum += range(part, other);
      squares_[static_cast<std::size_t>(part)] = static_cast<double>(sum.squaredNorm());
    };
    workers.run(static_cast<int>(parts), std::cref(add), &add_time_);
    const double norm = std::sqrt(std::accumulate(squares_.begin(), squares_.end(), 0.0));
    if (!std::isfinite(norm)) return norm;
    ++steps_;
    const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(steps_));
    const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(steps_));
    const float scale = static_cast<float>(std::min(1.0, options_.gradient_norm / (norm + 1e-12)));
    const float rate = static_cast<float>(learning_rate / correction1);
    const float spread = static_cast<float>(1 / std::sqrt(correction2)), epsilon = static_cast<float>(options_.epsilon);
    const auto descend = [&](int part) {
      const auto scaled = range(part, gradients[0]).array() * scale;
      auto first = range(part, first_moment_).array(), second = range(part, second_moment_).array();
      first = static_cast<float>(kBeta1) * first + static_cast<float>(1 - kBeta1) * scaled;
      second = static_cast<float>(kBeta2) * second + static_cast<float>(1 - kBeta2) * scaled.square();
      range(part, parameters).array() -= rate * first / (second.sqrt() * spread + epsilon);
    };
    workers.run(static_cast<int>(parts), std::cref(descend), &descend_time_);
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
  std::vector<double> squares_;  // of each part of a gradient
  std::uint64_t steps_ = 0;
  WorkerPool::PieceTime add_time_, descend_time_;
};

}  // namespace citylearn
