// SPDX-License-Identifier: Apache-2.0
// Updates that several trainers make together (docs/decisions/0021-ranks.md).
#include <algorithm>

#include "core/files/json.h"
#include "policy_service/learning/trainer_state.h"

namespace citylearn {

void Trainer::share_updates(UpdateSharing& sharing) {
  if (sharing.each_step() && !impl_->learner->share_gradients(nullptr))
    throw Error("cannot share gradients at each step", "learner '" + impl_->options.learner + "'",
                "share parameters once an update (--sync update), or choose another learner");
  impl_->sharing = &sharing;
  impl_->share({}, [] {});
}

double Trainer::elapsed() const { return impl_->elapsed; }

/// `learn` is the learner's own update.
void Trainer::Impl::share(LocalUpdate mine, const std::function<void()>& learn) {
  mine.updates = progress.updates;
  mine.generation = generation;
  mine.elapsed = elapsed;
  mine.progress = progress_json().dump();
  LearnerState state;
  learner->save(state);
  const LearnerState before = state;
  const auto once = [&](GradientSharing* gradients, LearnerState& after) {
    if (gradients) {
      learner->load(before);
      learner->share_gradients(gradients);
    }
    learn();
    learner->share_gradients(nullptr);
    learner->save(after);
  };
  const SharedUpdate shared = sharing->share(mine, once, state);
  if (mine.steps > 0)
    for (const int id : collector->environments()) collector->begin_segment(id);
  if (shared.progress) continue_from(read_progress(parse_json(*shared.progress, "progress of another rank")));
  learner->load(state);
  elapsed = shared.elapsed;
  progress.steps += shared.steps;
  if (shared.steps > 0) ++progress.updates;
  const std::uint64_t generation_before = generation;
  count_episodes(shared.episodes);  // may begin a new lesson
  if (shared.joined && shared.steps > 0) {
    // All begin anew with one that joins: it must not draw again what an earlier process of its rank has drawn.
    generation = std::max(generation, shared.generation);
    begin_generation();
  } else if (shared.progress && generation == generation_before) {
    collector->reset_all(generation, lesson().frames);
  }
}

}  // namespace citylearn
