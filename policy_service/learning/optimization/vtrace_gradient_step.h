// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/sequences.h"
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
        gradient_step_(name, parameters, task) {}

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

  /// Makes one step on `samples` actions. gather(which, half, trajectories) fills inputs, state and trajectories of
  /// half of the minibatch, or returns false where that half is empty.
  template <class Gather>
  void learn(double samples, const Gather& gather) {
    const LossWeights weights = gradient_step_.weights();
    std::array<double, 2> squares{};
    std::array<bool, 2> filled{};
    gradient_step_.begin_step();
    gradient_step_.both([&](int which, GradientStep::Half& half) {
      const auto w = static_cast<std::size_t>(which);
      TrajectoryBatch<float>& trajectories = trajectories_[w];
      filled[w] = gather(which, half, trajectories);
      if (!filled[w]) return;
      vtrace(limits_, half.forward(), half.inputs.agents, trajectories);
      for (std::size_t i = 0; i < trajectories.advantage.size(); ++i) {
        const double gain =
            static_cast<double>(trajectories.weight[i]) * static_cast<double>(trajectories.advantage[i]);
        squares[w] += gain * gain;
      }
    });
    const double spread = std::sqrt((squares[0] + squares[1]) / samples);
    const float scale = normalise_ ? static_cast<float>(1 / (spread + 1e-8)) : 1.0f;
    const float share = static_cast<float>(1 / samples);
    gradient_step_.both([&](int which, GradientStep::Half& half) {
      const auto w = static_cast<std::size_t>(which);
      if (!filled[w]) return;
      half.sums = vtrace_loss(weights, limits_, trajectories_[w], half.inputs, frames_, half.heads(), scale, share,
                              half.derivative);
      half.backward();
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
  const int frames_;
  const VtraceLimits limits_;
  const bool normalise_;
  std::array<TrajectoryBatch<float>, 2> trajectories_;
  double samples_ = 0;  // of this update
  GradientStep gradient_step_;
};

/// Makes room for B sequences of the model's length and the observation after each.
inline void make_room(const Rollout& model, int batch, GradientStep::Half& half, TrajectoryBatch<float>& trajectories) {
  half.inputs.resize(static_cast<int>(model.inputs.features.rows()), model.sequence + 1, batch);
  half.inputs.frames = model.inputs.frames;
  half.state.resize(model.states.rows(), batch);
  trajectories.resize(half.inputs.goal.size());
}

/// Copies a sequence as it happened to agent b of half of a minibatch.
inline void gather_sequence(const Track& track, int b, GradientStep::Half& half, TrajectoryBatch<float>& trajectories) {
  const Rollout& rollout = track.rollout();
  const std::ptrdiff_t batch = half.inputs.agents;
  half.state.col(b) = track.state();
  for (std::ptrdiff_t t = 0; t <= rollout.sequence; ++t) {
    const Track::Seen seen = track.seen(t);
    half.inputs.copy_column(seen.inputs, seen.column, t * batch + b);
    const auto k = static_cast<std::size_t>(t * batch + b);
    trajectories.action[k] = kNoAction;
    if (t == rollout.sequence) break;
    const auto f = static_cast<std::size_t>(track.column(t));
    trajectories.action[k] = rollout.action[f];
    trajectories.ended[k] = rollout.ended[f];
    trajectories.log_probability[k] = rollout.log_probability[f];
    trajectories.reward[k] = rollout.reward[f];
    trajectories.final_value[k] = rollout.final_value[f];
  }
}

}  // namespace citylearn
