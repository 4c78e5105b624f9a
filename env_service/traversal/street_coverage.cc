// SPDX-License-Identifier: Apache-2.0
#include "street_coverage.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "env_service/geometry/geometry.h"
#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

constexpr double kViewReach = 15;  // metres from a link's beginning: recordings with a frame every 15 m have no holes
constexpr double kViewTurn = 45;   // degrees between the way of a recording and a link
constexpr double kDirectionStep = 5;  // metres: nearer positions differ by the receiver's error, not by the way
constexpr double kDirectionGap = 50;  // metres: between positions farther apart a street may turn

/// Returns the direction of travel at each frame, degrees clockwise from north: to the next position that is some
/// metres on, or at the end of a stretch from the one before. NaN where it is not known.
std::vector<double> directions(const std::vector<double>& latitude, const std::vector<double>& longitude) {
  std::vector<double> found(latitude.size(), std::nan(""));
  std::size_t begin = found.size();  // the last position some metres on from those before
  double before = std::nan("");      // the direction to it
  const auto fill = [&](std::size_t end, double direction) {
    for (std::size_t frame = begin; frame < end; ++frame) found[frame] = direction;
  };
  for (std::size_t frame = 0; frame < found.size(); ++frame) {
    if (std::isnan(latitude[frame]) || std::isnan(longitude[frame])) continue;
    if (begin < found.size()) {
      const double metres = metres_between(latitude[begin], longitude[begin], latitude[frame], longitude[frame]);
      if (metres < kDirectionStep) continue;
      const double direction = metres > kDirectionGap ? std::nan("")
                                                      : heading_between(latitude[begin], longitude[begin],
                                                                        latitude[frame], longitude[frame]);
      fill(frame, std::isnan(direction) ? before : direction);
      before = direction;
    }
    begin = frame;
  }
  fill(found.size(), before);
  return found;
}

}  // namespace

std::vector<int> frames_along_links(const Traversal& recording, const StreetGraph& graph) {
  if (std::all_of(recording.latitude.begin(), recording.latitude.end(), [](double x) { return std::isnan(x); }))
    return {};
  const std::vector<double> way = directions(recording.latitude, recording.longitude);
  Grid grid(kViewReach);
  for (std::size_t frame = 0; frame < way.size(); ++frame)
    if (std::isfinite(way[frame]) && std::isfinite(recording.latitude[frame]))
      grid.add(on_earth(recording.latitude[frame], recording.longitude[frame]), static_cast<int>(frame));
  std::vector<int> frames(graph.links(), -1);
  std::vector<Grid::Near> near;
  for (const StreetPlace& place : graph.places()) {
    grid.near(on_earth(place.latitude, place.longitude), near);
    for (const StreetLink& link : place.links) {
      double nearest = kViewReach;
      for (const auto& [frame, metres] : near)
        if (metres < nearest &&
            std::abs(std::remainder(way[static_cast<std::size_t>(frame)] - link.heading, 360)) <= kViewTurn) {
          frames[static_cast<std::size_t>(link.line)] = frame;
          nearest = metres;
        }
    }
  }
  return frames;
}

StreetCoverage find_coverage(const StreetGraph& graph, const std::map<std::string, std::vector<int>>& shown_by) {
  StreetCoverage found;
  std::vector<bool> kept(graph.links(), true);
  std::string counts, unknown;
  for (const auto& [name, frames] : shown_by) {
    if (frames.empty()) {
      unknown += (unknown.empty() ? "; without positions: " : ", ") + name;
      continue;
    }
    found.frames[name] = frames;
    for (std::size_t link = 0; link < kept.size(); ++link) kept[link] = kept[link] && frames[link] >= 0;
    counts += fmt::format("{}{} {}", counts.empty() ? "" : ", ", name,
                          frames.size() - std::count(frames.begin(), frames.end(), -1));
  }
  const auto shown = std::count(kept.begin(), kept.end(), true);
  found.part = std::make_shared<const StreetGraph>(graph.strong_part(kept));
  if (!counts.empty()) counts += fmt::format(", all {}, of these there and back {}", shown, found.part->links());
  found.summary =
      fmt::format("streets: {} links, shown by {}{}", graph.links(), counts.empty() ? "none" : counts, unknown);
  for (auto& [name, frames] : found.frames) {
    std::size_t link = 0;
    std::erase_if(frames, [&](int) { return !kept[link++]; });
  }
  return found;
}

}  // namespace citylearn
