// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/sequences.h"
#include "policy_service/learning/optimization/vtrace_loss.h"

namespace citylearn {

/// Makes room for B sequences of the model's length and the observation after each.
inline void make_room(const Rollout& model, int batch, GradientStep::Shard& shard,
                      TrajectoryBatch<float>& trajectories) {
  shard.inputs.resize(static_cast<int>(model.inputs.features.rows()), model.sequence + 1, batch);
  shard.inputs.frames = model.inputs.frames;
  shard.state.resize(model.states.rows(), batch);
  trajectories.resize(shard.inputs.goal.size());
}

/// Copies a sequence as it happened to agent b of a shard of a minibatch.
inline void gather_sequence(const Track& track, int b, GradientStep::Shard& shard,
                            TrajectoryBatch<float>& trajectories) {
  const Rollout& rollout = track.rollout();
  const std::ptrdiff_t batch = shard.inputs.agents;
  shard.state.col(b) = track.state();
  for (std::ptrdiff_t t = 0; t <= rollout.sequence; ++t) {
    const Track::Seen seen = track.seen(t);
    shard.inputs.copy_column(seen.inputs, seen.column, t * batch + b);
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
