// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/section.h"

namespace citylearn::paper {

/// What the sections that carry agents to other routes and other recordings share.
struct Carriage {
  std::string agent, label;
  std::vector<std::uint64_t> seeds;
  double seconds = 0;  ///< of one training with all its steps, guessed
};

/// Of an agent whose training takes long.
std::vector<std::uint64_t> few_seeds(const Context& context);

/// features and place_filter.
std::vector<Carriage> carriages(const Context& context);

/// The learner of all of them: the one that needs the fewest episodes.
inline const std::string kCarriedLearner = "relabel";

/// The features that everybody sees there: 64 a frame, fewer where the route has fewer frames to learn them from.
std::string seen_in(World& world);

/// `share` of the recommended training steps, under the effort.
std::uint64_t steps_of(const Context& context, const std::string& agent, double share);

/// The training on the first `frames` places of the world's traversal learned from, whose agent is carried elsewhere.
Study source_of(const Context& context, World& world, const Carriage& carriage, std::uint64_t seed, int frames);

/// Remarks on which of the recordings an agent is worse than what learns nothing. `where`: "on" or "at" them; the rest
/// as trials_on() takes it.
void judge(Report& report, const std::string& who, const std::string& where, const std::vector<std::string>& recordings,
           const std::vector<Json>& agent, const std::vector<Json>& blind, const std::vector<Json>& filter);

}  // namespace citylearn::paper
