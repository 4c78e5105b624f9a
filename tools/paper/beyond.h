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

}  // namespace citylearn::paper
