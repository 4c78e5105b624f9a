// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/wire/messages.h"

namespace citylearn {

/// The contents that the env_services of one traversal must share, so that an agent sees the same on all of them.
struct TraversalContents {
  std::string traversal;
  std::uint64_t hash = 0;
  std::uint32_t feature_dimension = 0;
  std::optional<std::string> encoder;  ///< as in TraversalInfo; unset: unknown

  bool operator==(const TraversalContents&) const = default;
};

TraversalContents contents_of(const msg::TraversalInfo& info);

/// Requirements of a run for the env_services that it uses.
struct EnvRequirements {
  std::set<std::string> traversals;                ///< that the run uses; empty: all
  std::uint32_t first_frame = 0, frames = 0;       ///< the route; 0 frames: any
  std::optional<std::uint32_t> feature_dimension;  ///< that the agent needs; unset: any
  std::vector<TraversalContents> learned;          ///< of the training traversals, once they are known
};

/// Returns why frames first .. first + count - 1 are not a route on this traversal; empty when they are.
std::string route_misfit(const msg::TraversalInfo& info, std::uint32_t first, std::uint32_t count);

/// Returns how the features of contents are of another kind than those of `whose`; empty when they are not.
std::string features_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose);

/// Returns how contents differ from those of `whose`; empty when they do not.
std::string contents_misfit(const TraversalContents& contents, const TraversalContents& others,
                            const std::string& whose);

/// Returns why a run cannot use the env_service that announced this; empty when it can.
std::string misfit(const msg::TraversalInfo& info, const EnvRequirements& required);

}  // namespace citylearn
