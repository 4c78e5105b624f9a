// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace citylearn {

/// A robot's position, as the nearest of the places taught, and the frame that it sees. Both are indices on the
/// traversal. The frame may lie beyond the frames taught.
struct Sighting {
  int place = 0, frame = 0;
};

}  // namespace citylearn
