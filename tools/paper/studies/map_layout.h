// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <utility>
#include <vector>

#include "env_service/dataset_io/traversal.h"

namespace citylearn::paper {

/// A stretch of a route as it lies on a map.
struct Layout {
  int first = 0, frames = 0;                ///< of the recordings; place i of the layout is frame first + i
  std::vector<double> latitude, longitude;  ///< degrees, by place
  std::vector<int> turns;                   ///< where `stay` leads, by place; empty: it does not cross itself
};

/// Returns the first stretch of at most `places` frames that crosses itself most often, by the recording's GPS and
/// within 1.5 mean steps. It has no turns when there is no GPS or no crossing.
Layout recorded_layout(const Traversal& recording, int places);

/// Returns a route of `places` places along a Lissajous figure, x = sin 3t, y = sin 2t, with steps of 10 m. It crosses
/// itself seven times and ends shortly before its beginning. With fewer than 112 places some loops are too small for
/// their crossings to be found.
Layout drawn_layout(int places);

/// Metres east and north of the layout's first known place, by place; NaN where unknown.
std::pair<std::vector<double>, std::vector<double>> metres_of(const Layout& layout);

}  // namespace citylearn::paper
