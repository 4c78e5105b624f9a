// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <span>

#include "policy_service/learning/learner.h"
#include "policy_service/network/layers/product.h"
#include "policy_service/rollout/worker_pool.h"

namespace citylearn {

/// Adam (Kingma & Ba, 2015) on a gradient that is scaled down to a length where it is longer.
class Adam {
 public:
  struct Options {
    double epsilon = 1e-5;
    double gradient_norm = 0.5;  ///< the gradient's largest length
    int parts = 1;               ///< of the parameters, for as many threads
  };

  Adam(std::ptrdiff_t parameters, const Options& options) : options_(options) {
    first_moment_.setZero(parameters);
    second_moment_.setZero(parameters);
  }

  /// Makes one step. `norm` is the gradient's length. One that is not finite changes nothing: it would stay in the
  /// parameters for ever. `rounded` gets the parameters in bfloat16, unless it is empty.
  void step(double learning_rate, const Vector<float>& gradient, double norm, Vector<float>& parameters,
            std::span<std::uint16_t> rounded, WorkerPool& workers) {
    if (!std::isfinite(norm)) return;
    ++steps_;
    const double correction1 = 1 - std::pow(kBeta1, static_cast<double>(steps_));
    const double correction2 = 1 - std::pow(kBeta2, static_cast<double>(steps_));
    const float scale = static_cast<float>(std::min(1.0, options_.gradient_norm / (norm + 1e-12)));
    const float rate = static_cast<float>(learning_rate / correction1);
    const float spread = static_cast<float>(1 / std::sqrt(correction2)), epsilon = static_cast<float>(options_.epsilon);
    constexpr std::ptrdiff_t kBlock = 2048;  // numbers that stay in the cache from one line below to the next
    const auto descend = [&](int part) {
      const std::ptrdiff_t size = gradient.size(), end = (part + 1) * size / options_.parts;
      for (std::ptrdiff_t begin = part * size / options_.parts; begin < end; begin += kBlock) {
        const auto block = [&](auto& all) { return all.segment(begin, std::min(kBlock, end - begin)).array(); };
        const auto scaled = block(gradient) * scale;
        auto first = block(first_moment_), second = block(second_moment_);
        first = static_cast<float>(kBeta1) * first + static_cast<float>(1 - kBeta1) * scaled;
        second = static_cast<float>(kBeta2) * second + static_cast<float>(1 - kBeta2) * scaled.square();
        block(parameters) -= rate * first / (second.sqrt() * spread + epsilon);
        if (!rounded.empty())
          products::round_to_bfloat16(parameters.data() + begin, std::min(kBlock, end - begin), &rounded[begin]);
      }
    };
    workers.run(options_.parts, std::cref(descend), &descend_time_);
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
  WorkerPool::PieceTime descend_time_;
};

}  // namespace citylearn
