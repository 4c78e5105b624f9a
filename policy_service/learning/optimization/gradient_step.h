// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "policy_service/learning/optimization/adam.h"
#include "policy_service/learning/optimization/gradient_shard.h"
#include "policy_service/learning/optimization/random_streams.h"

namespace citylearn {

/// Performs gradient descent: holds the parameters, Adam, the run's schedules, and the shards of a minibatch that
/// threads work on. Their gradients are added in a fixed order, so results depend on the number of shards, but neither
/// on that of threads nor on timing.
class GradientStep {
 public:
  using Shard = GradientShard;

  GradientStep(const std::string& name, const Parameters& parameters, const LearnerTask& task);
  GradientStep(const GradientStep&) = delete;  // the shards look at the parameters
  GradientStep& operator=(const GradientStep&) = delete;
  /// Returns the parameters that it reads.
  static std::vector<ParameterSpec> parameter_specs();

  /// Returns the weights of the loss at this point of the run.
  LossWeights weights() const;
  double learning_rate() const;

  /// Returns the number of shards, the parameter `shards`.
  std::size_t shards() const { return shards_.size(); }
  /// Calls work(which, shard) for all shards at once, to fill and differentiate them. A shard left alone adds nothing.
  template <class Work>
  void for_each_shard(const Work& work) {
    const auto one = [&](int which) {
      const products::RoundedNumbers known(parameters_.data(), rounded_);
      work(static_cast<std::size_t>(which), shards_[static_cast<std::size_t>(which)]);
    };
    workers_.run(static_cast<int>(shards_.size()), std::cref(one));
  }
  /// Keeps these as they are: their gradient is zero, and so is their share of its length.
  void freeze(std::span<const Tensor> tensors) { frozen_.assign(tensors.begin(), tensors.end()); }
  /// Does what Learner::share_gradients() says.
  void share(GradientSharing* sharing) { sharing_ = sharing; }
  /// Does what Learner::set_progress() says.
  void set_progress(double fraction) { elapsed_ = std::min(1.0, fraction); }
  /// Ends a minibatch with one step of Adam.
  void end_step();
  /// Ends an update that learned from so many environment steps and returns its figures, means over `samples`.
  UpdateFigures end_update(std::size_t steps, double samples);

  std::uint64_t updates() const { return updates_; }
  std::uint64_t seed() const { return seed_; }
  const Vector<float>& parameters() const { return parameters_; }

  void save(LearnerState& state) const;
  /// Throws Error naming what is missing or of another size, before anything changes.
  void check(const LearnerState& state) const;
  /// Loads a state that passed check().
  void load(const LearnerState& state);

 private:
  const std::string name_;
  const std::uint64_t seed_;
  const double total_steps_, learning_rate_, learning_rate_end_, entropy_until_;
  const LossWeights weights_;

  Vector<float> parameters_;
  std::vector<std::uint16_t> rounded_;  // parameters_ in bfloat16, if products take them so
  std::uint64_t updates_ = 0, steps_ = 0;
  double elapsed_ = 0;  // fraction of the run that has passed by the clock
  std::unique_ptr<Adam> adam_;
  std::vector<Tensor> frozen_;
  const Tensor joined_;
  std::vector<Shard> shards_;
  Vector<float> gradient_;       // of all shards
  std::vector<double> squares_;  // of each part of it
  LossSums sums_;                // of this update
  double norms_ = 0, steps_taken_ = 0;
  WorkerPool& workers_;
  GradientSharing* sharing_ = nullptr;
  WorkerPool::PieceTime add_time_;
  std::vector<float> shared_;  // a gradient, and how many learners have one

  void round_parameters();
  /// Makes the shards' gradients one, in parts, and returns its length.
  double add_gradients();
  /// Makes this learner's gradient the mean of all that have one at this step. Returns false when none has.
  bool average(bool mine);
  double progress() const {
    return std::max(elapsed_, total_steps_ > 0 ? std::min(1.0, static_cast<double>(steps_) / total_steps_) : 0);
  }
};

}  // namespace citylearn
