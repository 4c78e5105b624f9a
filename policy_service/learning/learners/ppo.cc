// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "policy_service/learning/optimization/advantages.h"
#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/ppo_loss.h"
#include "policy_service/learning/optimization/sequences.h"

namespace citylearn {
namespace {

/// Proximal policy optimisation (Schulman et al., 2017) for recurrent networks: minibatches of whole sequences,
/// gradients through each from the recurrent state it was collected with.
class Ppo : public Learner {
 public:
  Ppo(const Parameters& parameters, const LearnerTask& task)
      : frames_(task.task.frames),
        epochs_(parameters.integer("epochs")),
        minibatch_(parameters.integer("minibatch")),
        gamma_(parameters["gamma"]),
        lambda_(parameters["lambda"]),
        normalise_(parameters.flag("normalise-advantages")),
        gradient_step_("ppo", parameters, task),
        samples_(gradient_step_.shards()) {
    weights_.clip = parameters["clip"];
    weights_.value_clip = parameters["value-clip"];
  }

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = GradientStep::parameter_specs();
    specs.insert(specs.end(),
                 {{"epochs", "passes of an update over its samples", 3, 1, 100, true},
                  {"minibatch", "sequences in a minibatch", 4, 1, 65536, true},
                  {"gamma", "discount per step", 0.99, 0, 1},
                  {"lambda", "of generalised advantage estimation", 0.95, 0, 1},
                  {"clip", "clip range of the probability ratio", 0.2, 0.01, 10},
                  {"value-clip", "value-loss clip range; 0 disables", 0.2, 0, 1000},
                  {"normalise-advantages", "1: an update's advantages get mean 0 and deviation 1", 1, 0, 1, true}});
    return specs;
  }

  void set_progress(double fraction) override { gradient_step_.set_progress(fraction); }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    list_sequences(rollouts, sequences_);
    estimate_advantages(rollouts, gamma_, lambda_, normalise_);
    static_cast<LossWeights&>(weights_) = gradient_step_.weights();
    const std::size_t batches = std::max<std::size_t>(1, sequences_.size() / static_cast<std::size_t>(minibatch_));
    Random random{gradient_step_.seed(), kShuffle, gradient_step_.updates()};
    for (int epoch = 0; epoch < epochs_; ++epoch) {
      shuffle(random, sequences_);
      for (std::size_t batch = 0; batch < batches; ++batch) learn(rollouts, part_of(sequences_, batch, batches));
    }
    std::size_t steps = 0;
    for (const Rollout* rollout : rollouts) steps += rollout->action.size();
    return gradient_step_.end_update(steps, static_cast<double>(steps) * epochs_);
  }

  const Vector<float>& parameters() const override { return gradient_step_.parameters(); }
  void save(LearnerState& state) const override { gradient_step_.save(state); }
  void load(const LearnerState& state) override {
    gradient_step_.check(state);
    gradient_step_.load(state);
  }
  bool share_gradients(GradientSharing* sharing) override {
    gradient_step_.share(sharing);
    return true;
  }
  bool freeze(std::span<const Tensor> tensors) override {
    gradient_step_.freeze(tensors);
    return true;
  }

 private:
  void learn(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen) {
    const float share = 1.0f / static_cast<float>(chosen.size() * static_cast<std::size_t>(rollouts[0]->sequence));
    gradient_step_.for_each_shard([&](std::size_t which, GradientStep::Shard& shard) {
      PpoSamples<float>& samples = samples_[which];
      if (!gather(rollouts, shard_of(chosen, which, gradient_step_.shards()), shard, samples)) return;
      const Heads<float>& heads = shard.forward();
      shard.sums = ppo_loss(weights_, samples, shard.inputs, frames_, heads, share, shard.derivative);
      shard.backward();
    });
    gradient_step_.end_step();
  }

  /// Returns false when nothing is chosen.
  static bool gather(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen, GradientStep::Shard& shard,
                     PpoSamples<float>& samples) {
    if (chosen.empty()) return false;
    const Rollout& model = *rollouts[0];
    const int length = model.sequence, batch = static_cast<int>(chosen.size());
    shard.inputs.resize(static_cast<int>(model.inputs.features.rows()), length, batch);
    shard.inputs.frames = model.inputs.frames;
    shard.state.resize(model.states.rows(), batch);
    samples.resize(static_cast<std::size_t>(length) * chosen.size());
    for (int b = 0; b < batch; ++b) {
      const Track track(rollouts, chosen[static_cast<std::size_t>(b)]);
      const Rollout& rollout = track.rollout();
      shard.state.col(b) = track.state();
      for (std::ptrdiff_t t = 0; t < length; ++t) {
        const std::ptrdiff_t from = track.column(t), to = t * batch + b;
        shard.inputs.copy_column(rollout.inputs, from, to);
        const auto f = static_cast<std::size_t>(from), k = static_cast<std::size_t>(to);
        samples.action[k] = rollout.action[f];
        samples.log_probability[k] = rollout.log_probability[f];
        samples.advantage[k] = rollout.advantage[f];
        samples.value[k] = rollout.value[f];
        samples.target[k] = rollout.target[f];
      }
    }
    return true;
  }

  const int frames_, epochs_, minibatch_;
  const double gamma_, lambda_;
  const bool normalise_;
  PpoWeights weights_;
  std::vector<Sequence> sequences_;
  GradientStep gradient_step_;
  std::vector<PpoSamples<float>> samples_;  // of each shard
};

const LearnerRegistry::Registration ppo_registration{
    {"ppo", "recurrent proximal policy optimisation with Adam", Ppo::parameter_specs(),
     [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return std::make_unique<Ppo>(parameters, task);
     }}};

}  // namespace
}  // namespace citylearn
