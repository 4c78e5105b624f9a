// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/optimization/gradient_step.h"

#include "policy_service/learning/optimization/saved_state.h"

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
      shards_(static_cast<std::size_t>(parameters.integer("shards"))),
      gradients_(shards_.size()),
      workers_(task.workers) {
  Random random{seed_, kInitialise};
  task.network.initialise(random, parameters_);
  adam_ = std::make_unique<Adam>(parameters_.size(),
                                 Adam::Options{parameters["adam-epsilon"], parameters["gradient-norm"]});
  for (std::size_t i = 0; i < shards_.size(); ++i) {
    Shard& shard = shards_[i];
    shard.network_ = &task.network;
    shard.parameters_ = &parameters_;
    shard.workspace_ = task.network.make_workspace();
    shard.workspace_->localise = weights_.localisation > 0 || weights_.orientation > 0;
    shard.gradient_ = &gradients_[i];
    shard.gradient_->resize(parameters_.size());
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

void GradientStep::begin_step() {
  for_each_shard([](std::size_t, Shard& shard) {
    shard.sums = {};
    shard.gradient_->setZero();
  });
}

void GradientStep::end_step() {
  // Adam then leaves them alone: moments that were never anything but zero move nothing.
  for (const Tensor& tensor : frozen_)
    for (Vector<float>& gradient : gradients_) gradient.segment(tensor.offset, tensor.rows * tensor.cols).setZero();
  if (sharing_) average(true);
  norms_ += adam_->step(learning_rate(), gradients_, parameters_, workers_);
  ++steps_taken_;
  for (const Shard& shard : shards_) sums_ += shard.sums;
}

bool GradientStep::average(bool mine) {
  for (std::size_t i = 1; i < gradients_.size(); ++i) {
    if (mine) gradients_[0] += gradients_[i];
    gradients_[i].setZero();
  }
  const auto size = static_cast<std::size_t>(gradients_[0].size());
  shared_.assign(size + 1, 0.0f);
  if (mine) {
    std::copy_n(gradients_[0].data(), size, shared_.begin());
    shared_.back() = 1;
  }
  sharing_->sum(shared_);
  const float learners = shared_.back();
  if (learners == 0) return false;
  gradients_[0] = Eigen::Map<const Vector<float>>(shared_.data(), gradients_[0].size()) / learners;
  return true;
}

UpdateFigures GradientStep::end_update(std::size_t steps, double samples) {
  // Others may have more minibatches. All stop together.
  while (sharing_ && average(false)) adam_->step(learning_rate(), gradients_, parameters_, workers_);
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
  adam_->load(state);
}

}  // namespace citylearn
