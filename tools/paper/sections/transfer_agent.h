// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/context.h"

namespace citylearn::paper {

/// Agents that are trained once and tried on other routes or other recordings of `world`: features and place_filter,
/// both with the learner that needs the fewest episodes.
std::vector<Context::Agent> transfer_agents(const Context& context, World& world);

/// The features that all agents see there: 64 a frame, fewer where the route has fewer frames to learn them from.
std::string common_representation(World& world);

/// `share` of the recommended training steps, under the effort.
std::uint64_t transfer_steps(const Context& context, const Context::Agent& agent, double share);

/// The training on the first `frames` places of the world's traversal learned from.
Study first_training(const Context& context, World& world, const Context::Agent& agent, std::uint64_t seed, int frames);

}  // namespace citylearn::paper
