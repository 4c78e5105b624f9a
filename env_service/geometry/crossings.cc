// SPDX-License-Identifier: Apache-2.0
#include "env_service/geometry/crossings.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <string>
#include <tuple>

#include "core/util/error.h"
#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

/// Two frames at one spot, the earlier one first.
struct Pair {
  double metres;
  int before, after;
  bool operator<(const Pair& other) const {
    return std::tie(metres, before, after) < std::tie(other.metres, other.before, other.after);
  }
};

/// A route's frames, NaN where unknown.
struct RoutePoints : std::vector<Point> {
  RoutePoints(const std::vector<double>& latitude, const std::vector<double>& longitude) {
    for (std::size_t i = 0; i < latitude.size(); ++i) push_back(on_earth(latitude[i], longitude[i]));
  }
  int frames() const { return static_cast<int>(size()); }
  const Point& point(int frame) const { return (*this)[static_cast<std::size_t>(frame)]; }
  double metres(int a, int b) const { return metres_between(point(a), point(b)); }  ///< NaN where unknown
};

/// Two stretches that run within reach of each other, as far as the route has been followed.
struct Approach {
  Pair nearest;
  int low, high;  ///< earlier frames within reach of
  int last;       ///< this frame
};

/// Returns the nearest pair of each approach of the route to itself, nearest first.
std::vector<Pair> nearest_pairs(const RoutePoints& route, const CrossingOptions& options) {
  Grid grid(options.metres);
  std::vector<Grid::Near> near;
  std::vector<Approach> open;
  std::vector<Pair> found;
  for (int frame = 0; frame < route.frames(); ++frame) {
    if (std::isnan(route.point(frame).x)) continue;
    // What comes before the way's last frame far off is another stretch.
    int out = frame - 1;
    while (out >= 0 && !(route.metres(out, frame) > 2 * options.metres)) --out;
    grid.near(route.point(frame), near);
    std::erase_if(near, [&](const Grid::Near& one) { return one.frame >= std::min(out, frame - options.spacing); });
    for (std::size_t begin = 0, end = 0; begin < near.size(); begin = end) {
      Approach here{{near[begin].metres, near[begin].frame, frame}, near[begin].frame, near[begin].frame, frame};
      for (end = begin; end < near.size() && near[end].frame - here.high <= options.spacing; ++end) {
        here.high = near[end].frame;
        here.nearest = std::min(here.nearest, {near[end].metres, near[end].frame, frame});
      }
      // It continues any number of approaches, of which one remains.
      std::erase_if(open, [&](const Approach& one) {
        const bool same = one.last >= frame - options.spacing && one.low <= here.high + options.spacing &&
                          one.high >= here.low - options.spacing;
        if (!same) return false;
        here.nearest = std::min(here.nearest, one.nearest);
        if (one.last == frame) {
          here.low = std::min(here.low, one.low);
          here.high = std::max(here.high, one.high);
        }
        return true;
      });
      open.push_back(here);
    }
    std::erase_if(open, [&](const Approach& one) {
      const bool over = one.last < frame - options.spacing;
      if (over) found.push_back(one.nearest);
      return over;
    });
    grid.add(route.point(frame), frame);
  }
  for (const Approach& one : open) found.push_back(one.nearest);
  std::sort(found.begin(), found.end());
  return found;
}

}  // namespace

std::vector<int> find_turns(const std::vector<double>& latitude, const std::vector<double>& longitude,
                            const CrossingOptions& options) {
  if (latitude.size() != longitude.size())
    throw Error("there are " + std::to_string(latitude.size()) + " latitudes and " + std::to_string(longitude.size()) +
                    " longitudes",
                "crossings of a route");
  if (!(options.metres > 0) || options.spacing < 1)
    throw Error("metres and spacing must be positive", "crossings of a route");
  const RoutePoints route(latitude, longitude);
  std::vector<std::vector<int>> junctions;
  // The junction that the road at `frame` passes already, or none.
  const auto passed = [&](int frame) {
    return std::find_if(junctions.begin(), junctions.end(), [&](const std::vector<int>& places) {
      return std::any_of(places.begin(), places.end(),
                         [&](int place) { return std::abs(place - frame) <= options.spacing; });
    });
  };
  for (const Pair& pair : nearest_pairs(route, options)) {
    const auto at_before = passed(pair.before), at_after = passed(pair.after);
    if (at_before == junctions.end() && at_after == junctions.end()) {
      junctions.push_back({pair.before, pair.after});
      continue;
    }
    if (at_before != junctions.end() && at_after != junctions.end()) continue;
    // A further road joins the junction, if that is within its reach.
    std::vector<int>& places = at_before != junctions.end() ? *at_before : *at_after;
    const int frame = at_before != junctions.end() ? pair.after : pair.before;
    if (std::all_of(places.begin(), places.end(),
                    [&](int place) { return route.metres(place, frame) <= options.metres; }))
      places.push_back(frame);
  }
  if (junctions.empty()) return {};
  std::vector<int> turns(latitude.size());
  std::iota(turns.begin(), turns.end(), 0);
  for (std::vector<int>& places : junctions) {
    std::sort(places.begin(), places.end());
    for (std::size_t i = 0; i < places.size(); ++i)
      turns[static_cast<std::size_t>(places[i])] = places[(i + 1) % places.size()];
  }
  return turns;
}

double crossing_reach(const std::vector<double>& latitude, const std::vector<double>& longitude) {
  const RoutePoints route(latitude, longitude);
  double sum = 0;
  int steps = 0;
  for (int frame = 1; frame < route.frames(); ++frame)
    if (const double metres = route.metres(frame - 1, frame); std::isfinite(metres)) {
      sum += metres;
      ++steps;
    }
  return sum > 0 ? 1.5 * sum / steps : std::numeric_limits<double>::quiet_NaN();
}

std::vector<std::vector<int>> junctions_of(const std::vector<int>& turns) {
  std::vector<std::vector<int>> junctions;
  for (std::size_t place = 0; place < turns.size(); ++place) {
    const int first = static_cast<int>(place);
    std::vector<int> places = {first};
    for (int next = turns[place]; next > first; next = turns[static_cast<std::size_t>(next)]) places.push_back(next);
    const bool lowest = turns[static_cast<std::size_t>(places.back())] == first;
    if (lowest && places.size() > 1) junctions.push_back(places);
  }
  return junctions;
}

}  // namespace citylearn
