// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/map_layout.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/task/route_map.h"
#include "env_service/geometry/crossings.h"
#include "env_service/geometry/plane.h"

namespace citylearn::paper {
namespace {

constexpr double kStep = 10;                             // metres between drawn places
constexpr double kHome = 50;                             // degrees north and east of the drawn map's middle
constexpr double kLeftOpen = 0.02;                       // share of the figure, so that its ends do not meet
constexpr double kDegreeNorth = kEarthRadius * kDegree;  // metres
constexpr int kPieces = 200'000;                         // the figure's length is the sum of so many

CrossingOptions reach_of(const std::vector<double>& latitude, const std::vector<double>& longitude) {
  CrossingOptions options;
  options.metres = crossing_reach(latitude, longitude);
  return options;
}

}  // namespace

Layout recorded_layout(const Traversal& recording, int places) {
  Layout layout;
  layout.frames = std::min(places, recording.frames);
  const CrossingOptions options = reach_of(recording.latitude, recording.longitude);
  if (!std::isfinite(options.metres)) return layout;
  const std::vector<int> turns = find_turns(recording.latitude, recording.longitude, options);
  // A crossing counts for every stretch that holds its first two places: gains[f] more stretches begin at f than end.
  std::vector<int> gains(static_cast<std::size_t>(recording.frames) + 1, 0);
  for (const std::vector<int>& junction : junctions_of(turns)) {
    const int from = std::max(0, junction[1] - layout.frames + 1);
    if (from > junction[0]) continue;
    ++gains[static_cast<std::size_t>(from)];
    --gains[static_cast<std::size_t>(junction[0] + 1)];
  }
  int count = 0, most = 0;
  for (int first = 0; first + layout.frames <= recording.frames; ++first) {
    count += gains[static_cast<std::size_t>(first)];
    if (count <= most) continue;
    most = count;
    layout.first = first;
  }
  layout.turns = turns_within(turns, layout.first, layout.frames);
  const auto stretch = [&](const std::vector<double>& all) {
    return std::vector<double>(all.begin() + layout.first, all.begin() + layout.first + layout.frames);
  };
  layout.latitude = stretch(recording.latitude);
  layout.longitude = stretch(recording.longitude);
  return layout;
}

Layout drawn_layout(int places) {
  const auto x = [](double t) { return std::sin(3 * t); };
  const auto y = [](double t) { return std::sin(2 * t); };
  // Begins where no other part of the figure is near.
  const double begin = 0.4, end = begin + 2 * std::numbers::pi * (1 - kLeftOpen), piece = (end - begin) / kPieces;
  const auto length = [&](int i) {
    const double from = begin + i * piece;
    return std::hypot(x(from + piece) - x(from), y(from + piece) - y(from));
  };
  double whole = 0;
  for (int i = 0; i < kPieces; ++i) whole += length(i);
  const double step = whole / (places - 1), metres = kStep / step;
  Layout layout;
  layout.frames = places;
  const auto add = [&](double t) {
    layout.latitude.push_back(kHome + metres * y(t) / kDegreeNorth);
    layout.longitude.push_back(kHome + metres * x(t) / (std::cos(kHome * kDegree) * kDegreeNorth));
  };
  double walked = 0;
  for (int i = 0; i < kPieces && static_cast<int>(layout.latitude.size()) + 1 < places; ++i) {
    if (walked >= step * static_cast<double>(layout.latitude.size())) add(begin + i * piece);
    walked += length(i);
  }
  add(end);
  layout.turns = find_turns(layout.latitude, layout.longitude, reach_of(layout.latitude, layout.longitude));
  return layout;
}

std::pair<std::vector<double>, std::vector<double>> metres_of(const Layout& layout) {
  std::size_t origin = 0;
  while (origin + 1 < layout.latitude.size() && !std::isfinite(layout.latitude[origin])) ++origin;
  const double width = std::cos(layout.latitude.at(origin) * kDegree) * kDegreeNorth;
  std::vector<double> east, north;
  for (std::size_t i = 0; i < layout.latitude.size(); ++i) {
    east.push_back(width * std::remainder(layout.longitude[i] - layout.longitude[origin], 360));
    north.push_back(kDegreeNorth * (layout.latitude[i] - layout.latitude[origin]));
  }
  return {east, north};
}

}  // namespace citylearn::paper
