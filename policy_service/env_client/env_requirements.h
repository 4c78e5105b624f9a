// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>

#include "core/wire/messages.h"
#include "policy_service/network/checkpoint/training_data.h"

namespace citylearn {

TraversalContents contents_of(const msg::TraversalInfo& info);

/// Requirements of a run for the env_services that it uses.
struct EnvRequirements {
  std::set<std::string> traversals;                ///< that the run uses; empty: all
  std::uint32_t first_frame = 0, frames = 0;       ///< the route; 0 frames: any
  std::optional<std::uint32_t> feature_dimension;  ///< that the agent needs; unset: any
  std::optional<bool> streets;                     ///< whether the run is on streets; unset: not known yet
  TrainingData learned;                            ///< what the agent learned or learns from, once it is known
};

/// Returns why frames first .. first + count - 1 are not a route on this traversal; empty when they are.
std::string route_misfit(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count);

/// Returns why a run cannot use the env_service that announced this; empty when it can.
std::string misfit(const msg::TraversalInfo& info, const EnvRequirements& required);

}  // namespace citylearn
