// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/optimization/gradient_step.h"

#include <cmath>
#include <numeric>
#include <utility>

#include "policy_service/learning/optimization/saved_state.h"
#include "policy_service/network/layers/product.h"

namespace citylearn {

GradientStep::GradientStep(const std::string& name, const Parameters& parameters, const LearnerTask& task)
    : name_("learner " + name),
      seed_(task.seed),
      total_steps_(static_cast<double>(task.total_steps)),
      learning_rate_(parameters["learning-rate"]),
      learning_rate_end_(parameters["learning-rate-end"]),
      entropy_until_(parameters["entropy-until"]),
      weights_{parameters["value-weight"], parameters["entropy"], parameters["localisation"],
               task.task.streets ? 0 : parameters["orientation"]},  // on streets numbers of places do not say the way
      joined_(task.network.joined_weights()),
      shards_(static_cast<std::size_t>(parameters.integer("shards"))),
      workers_(task.workers) {
  Random random{seed_, kInitialise};
  task.network.initialise(random, parameters_);
  const Adam::Options options{parameters["adam-epsilon"], parameters["gradient-norm"], parameters.integer("shards")};
  adam_ = std::make_unique<Adam>(parameters_.size(), options);
  gradient_.setZero(parameters_.size());
  round_parameters();
  for (Shard& shard : shards_) {
    shard.network_ = &task.network;
    shard.parameters_ = &parameters_;
    shard.workspace_ = task.network.make_workspace();
    shard.workspace_->localise = weights_.localisation > 0 || weights_.orientation > 0;
    shard.workspace_->joins = joined_.cols > 0;
    shard.gradient_.resize(parameters_.size());
  }
}

std::vector<ParameterSpec> GradientStep::parameter_specs() {
  return {{"learning-rate", "of Adam, at the start; falls linearly", 1e-3, 1e-8, 1},
          {"learning-rate-end", "learning rate at the end, as a share of that at the start", 0, 0, 1},
          {"value-weight", "of the value loss", 0.5, 0, 1000},
          {"entropy", "weight of the entropy bonus at the start", 0.02, 0, 10},
          {"entropy-until", "fraction of the run after which it reaches 0, linearly; 0 = it stays", 0, 0, 1},
          {"localisation", "weight of the auxiliary localisation loss (training only); 0 = none", 0, 0, 1000},
          {"orientation", "weight of the auxiliary loss of the way to the goal, likewise", 0, 0, 1000},
          {"gradient-norm", "maximum length of the gradient, which is clipped to it", 0.5, 1e-6, 1e6},
          {"adam-epsilon", "of Adam", 1e-5, 1e-12, 1},
          {"shards", "parts of a minibatch that as many threads differentiate; decides how gradients are rounded", 2, 1,
           256, true}};
}

double GradientStep::learning_rate() const { return learning_rate_ * (1 - (1 - learning_rate_end_) * progress()); }

LossWeights GradientStep::weights() const {
  LossWeights weights = weights_;
  if (entropy_until_ > 0) weights.entropy *= std::max(0.0, 1 - progress() / entropy_until_);
  return weights;
}

void GradientStep::round_parameters() {
  if (used_math() != Math::kOneDnnBfloat16) return;
  rounded_.resize(static_cast<std::size_t>(parameters_.size()));
  products::round_to_bfloat16(parameters_.data(), parameters_.size(), rounded_.data());
}

double GradientStep::add_gradients() {
  const int parts = static_cast<int>(shards_.size());
  squares_.assign(shards_.size(), 0);
  const auto add = [&](int part) {
    const auto range = [&](std::ptrdiff_t all) {  // of this part: where it begins, and its size
      const std::ptrdiff_t begin = all * part / parts;
      return std::pair(begin, all * (part + 1) / parts - begin);
    };
    double& sum = squares_[static_cast<std::size_t>(part)];
    for (const std::size_t side : {0, 1}) {
      const auto [begin, count] = range(beside(joined_, gradient_)[side].size());
      auto total = beside(joined_, gradient_)[side].segment(begin, count);
      total.setZero();
      for (Shard& shard : shards_)
        if (shard.differentiated_) total += beside(joined_, shard.gradient_)[side].segment(begin, count);
      sum += static_cast<double>(total.squaredNorm());
    }
    const auto [begin, count] = range(joined_.cols);
    if (count == 0) return;
    Eigen::Map<Matrix<float>> total(gradient_.data() + joined_.offset + begin * joined_.rows, joined_.rows, count);
    total.setZero();
    for (const Shard& shard : shards_)
      if (shard.differentiated_)
        add_product(total, *shard.workspace_->left, shard.workspace_->right->middleRows(begin, count).transpose());
    sum += static_cast<double>(total.squaredNorm());
  };
  workers_.run(parts, std::cref(add), &add_time_);
  return std::sqrt(std::accumulate(squares_.begin(), squares_.end(), 0.0));
}

void GradientStep::end_step() {
  double norm = add_gradients();
  // Adam then leaves them alone: moments that were never anything but zero move nothing.
  for (const Tensor& tensor : frozen_) gradient_.segment(tensor.offset, tensor.rows * tensor.cols).setZero();
  if (sharing_) average(true);
  if (sharing_ || !frozen_.empty()) norm = static_cast<double>(gradient_.norm());
  adam_->step(learning_rate(), gradient_, norm, parameters_, rounded_, workers_);
  norms_ += norm;
  ++steps_taken_;
  for (Shard& shard : shards_) {
    sums_ += std::exchange(shard.sums, {});
    shard.differentiated_ = false;
  }
}

bool GradientStep::average(bool mine) {
  const auto size = static_cast<std::size_t>(gradient_.size());
  shared_.assign(size + 1, 0.0f);
  if (mine) {
    std::copy_n(gradient_.data(), size, shared_.begin());
    shared_.back() = 1;
  }
  sharing_->sum(shared_);
  const float learners = shared_.back();
  if (learners == 0) return false;
  gradient_ = Eigen::Map<const Vector<float>>(shared_.data(), gradient_.size()) / learners;
  return true;
}

UpdateFigures GradientStep::end_update(std::size_t steps, double samples) {
  // Others may have more minibatches. All stop together.
  while (sharing_ && average(false))
    adam_->step(learning_rate(), gradient_, static_cast<double>(gradient_.norm()), parameters_, rounded_, workers_);
  UpdateFigures figures;
  figures.policy_loss = sums_.policy / samples;
  figures.value_loss = sums_.value / samples;
  figures.entropy = sums_.entropy / samples;
  figures.approx_kl = sums_.approx_kl / samples;
  figures.clip_fraction = sums_.clipped / samples;
  figures.localisation_loss = sums_.localisation / samples;
  figures.orientation_loss = sums_.orientation / samples;
  figures.gradient_norm = norms_ / steps_taken_;
  figures.learning_rate = learning_rate();
  steps_ += steps;
  ++updates_;
  sums_ = {};
  norms_ = steps_taken_ = 0;
  return figures;
}

void GradientStep::save(LearnerState& state) const {
  state.counters["updates"] = updates_;
  state.counters["steps"] = steps_;
  state.tensors["parameters"] = parameters_;
  adam_->save(state);
}

void GradientStep::check(const LearnerState& state) const {
  require_state(state, name_, {"updates", "steps", "adam_steps"}, {"parameters", "adam.first", "adam.second"},
                parameters_.size());
}

void GradientStep::load(const LearnerState& state) {
  updates_ = state.counters.at("updates");
  steps_ = state.counters.at("steps");
  sums_ = {};
  norms_ = steps_taken_ = 0;
  parameters_ = state.tensors.at("parameters");
  round_parameters();
  adam_->load(state);
}

}  // namespace citylearn
