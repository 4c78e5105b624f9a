// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "env_service/dataset_io/traversal.h"
#include "tools/chart/chart.h"

namespace citylearn::paper {

/// A stretch of a route as it lies on a map.
struct Layout {
  int first = 0, frames = 0;                ///< of the recordings; place i of the layout is frame first + i
  std::vector<double> latitude, longitude;  ///< degrees, by place
  std::vector<int> turns;                   ///< where `stay` leads, by place; empty: it does not cross itself
};

/// Of a recording with GPS the stretch of at most `places` frames that crosses itself most often (the first of those);
/// its crossings are found within 1.5 mean steps. Without turns when it has no GPS or never crosses itself.
Layout recorded_layout(const Traversal& recording, int places);

/// A route of `places` places drawn as a figure of Lissajous, x = sin 3t, y = sin 2t, with steps of 10 m: it crosses
/// itself seven times, and ends shortly before it would be where it began. With fewer than 112 places its loops are too
/// small for some of the crossings to be found.
Layout drawn_layout(int places);

/// "7 junctions".
std::string junctions_told(const Layout& layout);
/// Metres east and north of the layout's first known place.
Line on_the_map(const Layout& layout, const std::string& label, const std::vector<int>& places);
/// The layout with its junctions and what else shall be on it, as wide as high for the same metres.
Chart map_of(const Layout& layout, const std::string& title);

}  // namespace citylearn::paper
