// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// An agent that is trained once and tried on other routes or other recordings.
struct TransferAgent {
  std::string agent, label;
  std::vector<std::uint64_t> seeds;
  double seconds = 0;  ///< estimate for one training with all its steps
};

/// The seeds of an agent whose training takes long.
std::vector<std::uint64_t> few_seeds(const Context& context);

/// features and place_filter.
std::vector<TransferAgent> transfer_agents(const Context& context);

/// The learner of all of them: the one that needs the fewest episodes.
inline const std::string kTransferLearner = "relabel";

/// The features that all agents see there: 64 a frame, fewer where the route has fewer frames to learn them from.
std::string common_representation(World& world);

/// `share` of the recommended training steps, under the effort.
std::uint64_t transfer_steps(const Context& context, const std::string& agent, double share);

/// The training on the first `frames` places of the world's traversal learned from.
Study first_training(const Context& context, World& world, const TransferAgent& agent, std::uint64_t seed, int frames);

}  // namespace citylearn::paper
