// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>

#include "env_service/dataset_io/traversal.h"

namespace citylearn::paper {

/// A straight road, then a loop that crosses it, with a gap in the GPS.
inline Traversal looped_recording() {
  Traversal traversal;
  traversal.name = "looped";
  traversal.frames = 100;
  for (int i = 0; i < 100; ++i) {
    const double east = i < 60 ? i : i < 70 ? 60 : i < 90 ? 60 - (i - 70) : 40;
    const double north = i < 60 ? 0 : i < 70 ? i - 60 : i < 90 ? 10 : 10 - 2 * (i - 90);
    traversal.latitude.push_back(i == 5 ? NAN : 48 + north * 1e-4);
    traversal.longitude.push_back(11 + east * 1e-4);
  }
  return traversal;
}

}  // namespace citylearn::paper
