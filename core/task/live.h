// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace citylearn {

/// Name of the dataset of a route that a robot drives. Its traversals have the frames of the route as it was taught;
/// frames beyond them are pictures that the robot's camera takes, numbered in the order in which they come. So nobody
/// can have their features beforehand: an encoder_service makes them as observations name them.
inline constexpr const char* kLive = "live";

/// Returns whether a TraversalInfo announces one of them.
template <class TraversalInfo>
bool is_live(const TraversalInfo& info) {
  return std::string_view(info.dataset().c_str()) == kLive;
}

}  // namespace citylearn
