// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/optimization/gather_sequence.h"
#include "policy_service/learning/optimization/vtrace_gradient_step.h"

namespace citylearn {
namespace {

/// The learner of IMPALA (Espeholt et al., 2018) for recurrent networks: an actor-critic that corrects for what its
/// samples were collected by older parameters, whether these come from actors that lag or from earlier passes.
class Vtrace : public Learner {
 public:
  Vtrace(const Parameters& parameters, const LearnerTask& task)
      : epochs_(parameters.integer("epochs")),
        minibatch_(parameters.integer("minibatch")),
        vtrace_("vtrace", parameters, task) {}

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = VtraceGradientStep::parameter_specs();
    specs.insert(specs.end(), {{"epochs", "passes of an update over its samples", 1, 1, 100, true},
                               {"minibatch", "sequences in a minibatch", 4, 1, 65536, true}});
    return specs;
  }

  void set_progress(double fraction) override { vtrace_.gradient_step().set_progress(fraction); }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    list_sequences(rollouts, sequences_);
    const std::size_t batches = std::max<std::size_t>(1, sequences_.size() / static_cast<std::size_t>(minibatch_));
    Random random{vtrace_.gradient_step().seed(), kShuffle, vtrace_.gradient_step().updates()};
    for (int epoch = 0; epoch < epochs_; ++epoch) {
      shuffle(random, sequences_);
      for (std::size_t batch = 0; batch < batches; ++batch) learn(rollouts, part_of(sequences_, batch, batches));
    }
    return vtrace_.end_update(rollouts);
  }

  const Vector<float>& parameters() const override { return vtrace_.gradient_step().parameters(); }
  void save(LearnerState& state) const override { vtrace_.gradient_step().save(state); }
  void load(const LearnerState& state) override {
    vtrace_.gradient_step().check(state);
    vtrace_.gradient_step().load(state);
  }
  bool share_gradients(GradientSharing* sharing) override {
    vtrace_.gradient_step().share(sharing);
    return true;
  }
  bool freeze(std::span<const Tensor> tensors) override {
    vtrace_.gradient_step().freeze(tensors);
    return true;
  }

 private:
  void learn(std::span<Rollout* const> rollouts, std::span<const Sequence> chosen) {
    const double samples = static_cast<double>(chosen.size()) * rollouts[0]->sequence;
    vtrace_.learn(samples, [&](std::size_t which, GradientStep::Shard& shard, TrajectoryBatch<float>& trajectories) {
      const std::span<const Sequence> mine = shard_of(chosen, which, vtrace_.gradient_step().shards());
      if (mine.empty()) return false;
      make_room(*rollouts[0], static_cast<int>(mine.size()), shard, trajectories);
      for (std::size_t b = 0; b < mine.size(); ++b)
        gather_sequence(Track(rollouts, mine[b]), static_cast<int>(b), shard, trajectories);
      return true;
    });
  }

  const int epochs_, minibatch_;
  std::vector<Sequence> sequences_;
  VtraceGradientStep vtrace_;
};

const LearnerRegistry::Registration vtrace_registration{
    {"vtrace", "recurrent off-policy actor-critic of IMPALA", Vtrace::parameter_specs(),
     [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return std::make_unique<Vtrace>(parameters, task);
     }}};

}  // namespace
}  // namespace citylearn
