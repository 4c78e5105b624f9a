// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <vector>

#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/sequences.h"
#include "policy_service/learning/optimization/vtrace_loss.h"

namespace citylearn {

/// Descent by V-trace, which learns from what other policies than the present one did. Targets come from the present
/// network's own values, anew in each minibatch.
class VtraceDescent {
 public:
  VtraceDescent(const std::string& name, const Parameters& parameters, const LearnerTask& task)
      : frames_(task.task.frames),
        limits_{parameters["gamma"], parameters["lambda"], parameters["rho"], parameters["c"]},
        normalise_(parameters.flag("normalise-advantages")),
        descent_(name, parameters, task) {}

  static std::vector<ParameterSpec> parameter_specs() {
    std::vector<ParameterSpec> specs = Descent::parameter_specs();
    specs.insert(specs.end(),
                 {{"gamma", "discount a step", 0.99, 0, 1},
                  {"lambda", "1: targets as far ahead as policies agree; less trusts the values more", 1, 0, 1},
                  {"rho", "a step's importance weight is cut off here", 1, 0.01, 100},
                  {"c", "and the weight of what follows it here", 1, 0.01, 100},
                  {"normalise-advantages", "1: a minibatch's advantages get mean square 1", 1, 0, 1, true}});
    return specs;
  }

  /// One step of descent on `samples` actions. gather(which, half, walk) fills inputs, state and walk of half of the
  /// minibatch, or says false where that half is empty.
  template <class Gather>
  void learn(double samples, const Gather& gather) {
    const LossWeights weights = descent_.weights();
    std::array<double, 2> squares{};
    std::array<bool, 2> filled{};
    descent_.begin_step();
    descent_.both([&](int which, Descent::Half& half) {
      const auto w = static_cast<std::size_t>(which);
      Walk<float>& walk = walks_[w];
      filled[w] = gather(which, half, walk);
      if (!filled[w]) return;
      vtrace(limits_, half.forward(), half.inputs.agents, walk);
      for (std::size_t i = 0; i < walk.advantage.size(); ++i) {
        const double gain = static_cast<double>(walk.weight[i]) * static_cast<double>(walk.advantage[i]);
        squares[w] += gain * gain;
      }
    });
    const double spread = std::sqrt((squares[0] + squares[1]) / samples);
    const float scale = normalise_ ? static_cast<float>(1 / (spread + 1e-8)) : 1.0f;
    const float share = static_cast<float>(1 / samples);
    descent_.both([&](int which, Descent::Half& half) {
      const auto w = static_cast<std::size_t>(which);
      if (!filled[w]) return;
      half.sums =
          vtrace_loss(weights, limits_, walks_[w], half.inputs, frames_, half.heads(), scale, share, half.derivative);
      half.backward();
    });
    descent_.end_step();
    samples_ += samples;
  }

  UpdateFigures end_update(std::span<Rollout* const> rollouts) {
    std::size_t steps = 0;
    for (const Rollout* rollout : rollouts) steps += rollout->action.size();
    const UpdateFigures figures = descent_.end_update(steps, samples_);
    samples_ = 0;
    return figures;
  }

  Descent& descent() { return descent_; }
  const Descent& descent() const { return descent_; }

 private:
  const int frames_;
  const VtraceLimits limits_;
  const bool normalise_;
  std::array<Walk<float>, 2> walks_;
  double samples_ = 0;  // of this update
  Descent descent_;
};

/// Makes room for B sequences of the model's length and what each goes on with.
inline void make_room(const Rollout& model, int batch, Descent::Half& half, Walk<float>& walk) {
  half.inputs.resize(static_cast<int>(model.inputs.features.rows()), model.sequence + 1, batch);
  half.inputs.frames = model.inputs.frames;
  half.state.resize(model.states.rows(), batch);
  walk.resize(half.inputs.goal.size());
}

/// Copies a sequence as it happened to agent b of half of a minibatch.
inline void gather_sequence(const Track& track, int b, Descent::Half& half, Walk<float>& walk) {
  const Rollout& rollout = track.rollout();
  const std::ptrdiff_t batch = half.inputs.agents;
  half.state.col(b) = track.state();
  for (std::ptrdiff_t t = 0; t <= rollout.sequence; ++t) {
    const Track::Seen seen = track.seen(t);
    half.inputs.copy_column(seen.inputs, seen.column, t * batch + b);
    const auto k = static_cast<std::size_t>(t * batch + b);
    walk.action[k] = kNoAction;
    if (t == rollout.sequence) break;
    const auto f = static_cast<std::size_t>(track.column(t));
    walk.action[k] = rollout.action[f];
    walk.ended[k] = rollout.ended[f];
    walk.log_probability[k] = rollout.log_probability[f];
    walk.reward[k] = rollout.reward[f];
    walk.final_value[k] = rollout.final_value[f];
  }
}

}  // namespace citylearn
