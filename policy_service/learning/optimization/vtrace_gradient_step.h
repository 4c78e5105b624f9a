// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <vector>

#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/vtrace_loss.h"

namespace citylearn {

/// Performs gradient steps by V-trace, which learns from what other policies than the present one did. Targets come
/// from the present network's values, anew in each minibatch.
class VtraceGradientStep {
 public:
  VtraceGradientStep(const std::string& name, const Parameters& parameters, const LearnerTask& task)
      : frames_(task.task.frames),
        limits_{parameters["gamma"], parameters["lambda"], parameters["rho"], parameters["c"]},
        normalise_(parameters.flag("normalise-advantages")),
        gradient_step_(name, parameters, task),
        parts_(gradient_step_.shards()) {}

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = GradientStep::parameter_specs();
    specs.insert(
        specs.end(),
        {{"gamma", "discount per step", 0.99, 0, 1},
         {"lambda", "1: targets reach as far as the policies agree; smaller values trust the critic more", 1, 0, 1},
         {"rho", "upper limit of a step's importance weight", 1, 0.01, 100},
         {"c", "upper limit of the trace coefficient", 1, 0.01, 100},
         {"normalise-advantages", "1: a minibatch's advantages get mean square 1", 1, 0, 1, true}});
    return specs;
  }

  /// Makes one step on `samples` actions. gather(which, shard, trajectories) fills inputs, state and trajectories of
  /// that shard of the minibatch, or returns false where it is empty.
  template <class Gather>
  void learn(double samples, const Gather& gather) {
    const LossWeights weights = gradient_step_.weights();
    gradient_step_.for_each_shard([&](std::size_t which, GradientStep::Shard& shard) {
      Part& part = parts_[which];
      TrajectoryBatch<float>& trajectories = part.trajectories;
      part.squares = 0;
      part.filled = gather(which, shard, trajectories);
      if (!part.filled) return;
      vtrace(limits_, shard.forward(), shard.inputs.agents, trajectories);
      for (std::size_t i = 0; i < trajectories.advantage.size(); ++i) {
        const double gain =
            static_cast<double>(trajectories.weight[i]) * static_cast<double>(trajectories.advantage[i]);
        part.squares += gain * gain;
      }
    });
    double squares = 0;
    for (const Part& part : parts_) squares += part.squares;
    const double spread = std::sqrt(squares / samples);
    const float scale = normalise_ ? static_cast<float>(1 / (spread + 1e-8)) : 1.0f;
    const float share = static_cast<float>(1 / samples);
    gradient_step_.for_each_shard([&](std::size_t which, GradientStep::Shard& shard) {
      const Part& part = parts_[which];
      if (!part.filled) return;
      shard.sums = vtrace_loss(weights, limits_, part.trajectories, shard.inputs, frames_, shard.heads(), scale, share,
                               shard.derivative);
      shard.backward();
    });
    gradient_step_.end_step();
    samples_ += samples;
  }

  UpdateFigures end_update(std::span<Rollout* const> rollouts) {
    std::size_t steps = 0;
    for (const Rollout* rollout : rollouts) steps += rollout->action.size();
    const UpdateFigures figures = gradient_step_.end_update(steps, samples_);
    samples_ = 0;
    return figures;
  }

  GradientStep& gradient_step() { return gradient_step_; }
  const GradientStep& gradient_step() const { return gradient_step_; }

 private:
  struct Part {
    TrajectoryBatch<float> trajectories;
    double squares = 0;  // sum of the policy gradient's squared factors
    bool filled = false;
  };

  const int frames_;
  const VtraceLimits limits_;
  const bool normalise_;
  double samples_ = 0;  // of this update
  GradientStep gradient_step_;
  std::vector<Part> parts_;  // of each shard
};

}  // namespace citylearn
