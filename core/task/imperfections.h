// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

namespace citylearn {

/// Imperfections of the world of an env_service. Zero, the default of all, changes nothing.
struct Imperfections {
  double slip = 0;            ///< --slip P: probability that an action slips, so that it is done never or twice
  double dropped_frames = 0;  ///< --dropped-frames P: probability that after a step the frame before is seen again
  int kidnappings = 0;        ///< --kidnappings N: times an episode that the agent is carried to another place

  bool operator==(const Imperfections&) const = default;
};

/// Returns what an imperfect world is called: "slip0.1-kidnap1"; empty where it is perfect.
std::string world_of(const Imperfections& imperfections);
/// Returns what the name of a traversal says of its world: "slip0.1-kidnap1" of "summer-slip0.1-kidnap1"; else "".
std::string world_of(const std::string& traversal);

/// Returns the name of a recording's traversal in a world, "summer-slip0.1". Where there is no room for both, the name
/// of the recording is cut.
std::string name_in_world(const std::string& recording, const std::string& world);

}  // namespace citylearn
