// SPDX-License-Identifier: Apache-2.0
#include "policy_service/learning/learners/relabel.h"

#include "policy_service/learning/optimization/gather_sequence.h"
#include "policy_service/learning/optimization/vtrace_gradient_step.h"

namespace citylearn {
namespace {

/// Learns from what its agents did as if they had meant to go elsewhere: hindsight experience replay (Andrychowicz et
/// al., 2017) for policy gradients (Rauber et al., 2019). The last sequences are kept and lived again with other goals,
/// for which the rewards are known exactly; what the present policy would have done with those goals is corrected for
/// by V-trace (Espeholt et al., 2018) instead of the importance sampling of Rauber et al.
class Relabel : public Learner {
 public:
  Relabel(const Parameters& parameters, const LearnerTask& task)
      : task_(task.task),
        epochs_(parameters["epochs"]),
        minibatch_(static_cast<std::size_t>(parameters.integer("minibatch"))),
        relabelled_(parameters["relabelled"]),
        visited_(parameters["visited"]),
        replay_(static_cast<std::size_t>(parameters["replay"])),
        vtrace_(kName, parameters, task) {}

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = VtraceGradientStep::parameter_specs();
    specs.insert(specs.end(),
                 {{"epochs", "samples learned from per new sample", 8, 0.01, 1000},
                  {"minibatch", "sequences in a minibatch", 8, 1, 65536, true},
                  {"relabelled", "fraction of these from the replay, with other goals", 0.75, 0, 1},
                  {"visited", "fraction of other goals that the trajectory passes; else any place", 0.5, 0, 1},
                  {"replay", "steps kept, at 4 bytes for each feature", 16384, 1, 1e8, true}});
    return specs;
  }

  void set_progress(double fraction) override { vtrace_.gradient_step().set_progress(fraction); }
  UpdateFigures update(std::span<Rollout* const> rollouts) override {
    if (rollouts[0]->max_steps < 1)
      throw Error("must be at least 1", "max_steps of a rollout", "its collector knows the step limit");
    replay_.add(rollouts);
    use_map();
    list_sequences(rollouts, sequences_);
    Random shuffling{vtrace_.gradient_step().seed(), kShuffle, vtrace_.gradient_step().updates()};
    Random choosing{vtrace_.gradient_step().seed(), kRelabel, vtrace_.gradient_step().updates()};
    const auto batches = static_cast<std::size_t>(
        std::max(1.0, std::round(epochs_ * static_cast<double>(sequences_.size()) / static_cast<double>(minibatch_))));
    std::size_t next = sequences_.size();
    for (std::size_t batch = 0; batch < batches; ++batch) {
      chosen_.resize(minibatch_);
      for (Choice& choice : chosen_) {
        choice.relabelled = choosing.uniform() < relabelled_;
        if (choice.relabelled) {
          choice.slot = choosing.below(replay_.size());
          choice.seed = choosing.next();
          continue;
        }
        if (next == sequences_.size()) {
          shuffle(shuffling, sequences_);
          next = 0;
        }
        choice.sequence = sequences_[next++];
      }
      learn(rollouts);
    }
    return vtrace_.end_update(rollouts);
  }

  const Vector<float>& parameters() const override { return vtrace_.gradient_step().parameters(); }
  void save(LearnerState& state) const override {
    vtrace_.gradient_step().save(state);
    replay_.save(state);
  }
  void load(const LearnerState& state) override {
    vtrace_.gradient_step().check(state);
    replay_.check(state, std::string("learner ") + kName, task_);
    vtrace_.gradient_step().load(state);
    replay_.load(state, task_.features);
  }
  bool freeze(std::span<const Tensor> tensors) override {
    vtrace_.gradient_step().freeze(tensors);
    return true;
  }

 private:
  static constexpr const char* kName = "relabel";

  struct Choice {
    bool relabelled = false;
    Sequence sequence{};     // as it happened
    std::size_t slot = 0;    // of the replay
    std::uint64_t seed = 0;  // of the goals
  };

  /// Gives each thread the map of the present lesson.
  void use_map() {
    if (!maps_.empty() && (task_.streets || maps_.front().states->places() == replay_.frames())) return;
    const auto map = task_.streets ? task_.streets : std::make_shared<const StateMap>(replay_.frames());
    maps_.clear();
    for (std::size_t shard = 0; shard < vtrace_.gradient_step().shards(); ++shard) maps_.push_back({map});
  }

  void learn(std::span<Rollout* const> rollouts) {
    const double samples = static_cast<double>(chosen_.size()) * rollouts[0]->sequence;
    vtrace_.learn(samples, [&](std::size_t which, GradientStep::Shard& shard, TrajectoryBatch<float>& trajectories) {
      const auto mine = shard_of(std::span<const Choice>(chosen_), which, vtrace_.gradient_step().shards());
      if (mine.empty()) return false;
      make_room(*rollouts[0], static_cast<int>(mine.size()), shard, trajectories);
      int b = 0;
      for (const Choice& choice : mine) {
        Random random{choice.seed};
        if (choice.relabelled)
          relabel(replay_, choice.slot, visited_, *rollouts[0], maps_[which], random, b, shard, trajectories);
        else
          gather_sequence(Track(rollouts, choice.sequence), b, shard, trajectories);
        ++b;
      }
      return true;
    });
  }

  const NetworkTask& task_;
  const double epochs_;
  const std::size_t minibatch_;
  const double relabelled_, visited_;
  Replay replay_;
  std::vector<RelabelMap> maps_;  // of each shard
  std::vector<Sequence> sequences_;
  std::vector<Choice> chosen_;
  VtraceGradientStep vtrace_;
};

const LearnerRegistry::Registration relabel_registration{
    {"relabel", "hindsight: replays stored episodes with substituted goals, corrected by V-trace",
     Relabel::parameter_specs(), [](const Parameters& parameters, const LearnerTask& task) -> std::unique_ptr<Learner> {
       return std::make_unique<Relabel>(parameters, task);
     }}};

}  // namespace
}  // namespace citylearn
