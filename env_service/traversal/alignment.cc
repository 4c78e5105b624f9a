// SPDX-License-Identifier: Apache-2.0
#include "alignment.h"

#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <string>

#include "core/util/error.h"
#include "env_service/geometry/geometry.h"
#include "env_service/geometry/plane.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxCandidates = std::size_t{1} << 26;

std::string frame_of(const Traversal& traversal, int frame) {
  return "frame " + std::to_string(frame) + " of " + traversal.name;
}

std::string rounded(double number) { return fmt::format("{:.1f}", number); }

/// The cheapest choice of one candidate a step (Viterbi's algorithm). A path runs along the frames or against them: it
/// never goes the other way, or else the fewest times. Against them metres count twice: there and back, a route runs
/// both ways. Candidates of a step are sorted by frame.
class Path {
 public:
  void add_step(const std::vector<Grid::Near>& candidates) {
    const std::size_t before = begins_.empty() ? 0 : begins_.back(), now = entries_.size(), count = candidates.size();
    if (now + 2 * count > kMaxCandidates)
      throw Error("too many frames are near each other", "--align-by gps",
                  "lower --align-within, or cut with --frames");
    std::size_t best_any = before;
    for (std::size_t i = before; i < now; ++i)
      if (costs_[i - before] < costs_[best_any - before]) best_any = i;
    // Entries of a step: the candidates of paths along the frames, then in reverse those of paths against them.
    std::vector<Cost> costs(2 * count);
    std::size_t best = now, at = before;  // best: the cheapest predecessor that does not lie ahead
    for (std::size_t c = 0; c < 2 * count; ++c) {
      const bool against = c >= count;
      const std::size_t end = against ? now : before + (now - before) / 2;
      if (c == count) {
        at = before + (now - before) / 2;
        best = now;
      }
      const auto& [frame, metres] = candidates[against ? 2 * count - 1 - c : c];
      for (; at < end && (against ? entries_[at].frame >= frame : entries_[at].frame <= frame); ++at)
        if (best == now || costs_[at - before] < costs_[best - before]) best = at;
      std::size_t from = best;
      Cost& cost = costs[c];
      if (now > before) {
        Cost back = costs_[best_any - before];
        ++back.returns;
        if (best == now || back < costs_[best - before]) from = best_any;
        cost = from == best ? costs_[best - before] : back;
      }
      cost.metres += against ? 2 * metres : metres;
      entries_.push_back({frame, static_cast<std::uint32_t>(from)});
    }
    begins_.push_back(now);
    costs_ = std::move(costs);
  }

  std::vector<int> frames() const {
    std::vector<int> frames(begins_.size());
    if (frames.empty()) return frames;
    std::size_t at =
        begins_.back() + static_cast<std::size_t>(std::min_element(costs_.begin(), costs_.end()) - costs_.begin());
    for (std::size_t step = frames.size(); step-- > 0; at = entries_[at].from) frames[step] = entries_[at].frame;
    return frames;
  }

 private:
  struct Cost {
    int returns = 0;
    double metres = 0;
    bool operator<(const Cost& other) const {
      return returns != other.returns ? returns < other.returns : metres < other.metres;
    }
  };
  struct Entry {
    int frame;
    std::uint32_t from;
  };
  std::vector<Entry> entries_;
  std::vector<std::size_t> begins_;  ///< of each step
  std::vector<Cost> costs_;          ///< of the last step's entries
};

bool known(const Traversal& one, int frame) {
  const auto i = static_cast<std::size_t>(frame);
  return i < one.latitude.size() && std::isfinite(one.latitude[i]) && std::isfinite(one.longitude[i]);
}
Point place(const Traversal& one, int frame) {
  return on_earth(one.latitude[static_cast<std::size_t>(frame)], one.longitude[static_cast<std::size_t>(frame)]);
}
double metres_apart(const Traversal& a, int frame_a, const Traversal& b, int frame_b) {
  const auto i = static_cast<std::size_t>(frame_a), j = static_cast<std::size_t>(frame_b);
  return metres_between(a.latitude[i], a.longitude[i], b.latitude[j], b.longitude[j]);
}

}  // namespace

std::vector<int> align_by_index(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal) {
  for (const int frame : frames)
    if (frame >= traversal.frames)
      throw Error(frame_of(sibling, frame) + " has no counterpart, " + traversal.name + " has " +
                      std::to_string(traversal.frames) + " frames",
                  "--align-by index", "cut with --frames, or align another way");
  return frames;
}

std::vector<int> align_by_matches(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                  std::vector<std::pair<int, int>> matches) {
  const std::string where = "--align-by matches";
  if (matches.empty()) throw Error("there are no matches of " + sibling.name + " and " + traversal.name, where);
  for (const auto& [a, b] : matches)
    if (a < 0 || a >= sibling.frames || b < 0 || b >= traversal.frames)
      throw Error("the match of frames " + std::to_string(a) + " and " + std::to_string(b) + " is beyond " +
                      sibling.name + " (" + std::to_string(sibling.frames) + " frames) or " + traversal.name + " (" +
                      std::to_string(traversal.frames) + " frames)",
                  where, "the match file belongs to other recordings");
  std::stable_sort(matches.begin(), matches.end(), [](auto& a, auto& b) { return a.first < b.first; });
  matches.erase(std::unique(matches.begin(), matches.end(), [](auto& a, auto& b) { return a.first == b.first; }),
                matches.end());
  std::vector<int> found;
  for (const int frame : frames) {
    const auto after =
        std::lower_bound(matches.begin(), matches.end(), frame, [](auto& match, int at) { return match.first < at; });
    if (after == matches.end() || (after == matches.begin() && after->first != frame))
      throw Error(frame_of(sibling, frame) + " has no match, they go from " + std::to_string(matches.front().first) +
                      " to " + std::to_string(matches.back().first),
                  where, "cut with --frames");
    if (after->first == frame) {
      found.push_back(after->second);
      continue;
    }
    const auto before = after - 1;
    const double share = static_cast<double>(frame - before->first) / (after->first - before->first);
    found.push_back(static_cast<int>(std::lround(before->second + share * (after->second - before->second))));
  }
  return found;
}

std::vector<int> align_by_distance(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                                   double tolerance) {
  const std::string where = "--align-by distance";
  std::vector<std::pair<float, int>> route;
  for (int frame = 0; frame < traversal.frames; ++frame)
    if (const float metres = traversal.positions[static_cast<std::size_t>(frame)]; std::isfinite(metres))
      route.emplace_back(metres, frame);
  if (route.empty()) throw Error("positions of " + traversal.name + " are not known", where, "align by index");
  std::stable_sort(route.begin(), route.end(), [](auto& a, auto& b) { return a.first < b.first; });
  std::vector<int> found;
  for (const int frame : frames) {
    const float metres = sibling.positions[static_cast<std::size_t>(frame)];
    if (!std::isfinite(metres))
      throw Error("the position of " + frame_of(sibling, frame) + " is not known", where, "cut with --frames");
    auto near =
        std::lower_bound(route.begin(), route.end(), metres, [](auto& point, float at) { return point.first < at; });
    if (near == route.end() || (near != route.begin() && metres - (near - 1)->first < near->first - metres)) --near;
    // Standing still: the first frame at that place, whichever neighbour was found.
    near = std::lower_bound(route.begin(), near, near->first, [](auto& point, float at) { return point.first < at; });
    const double apart = std::abs(static_cast<double>(near->first) - metres);
    if (apart > tolerance)
      throw Error(frame_of(sibling, frame) + " at " + rounded(metres) + " m is " + rounded(apart) +
                      " m from the nearest frame of " + traversal.name,
                  where, "cut with --frames, or raise --align-within");
    found.push_back(near->second);
  }
  return found;
}

std::vector<int> align_by_gps(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                              double tolerance) {
  const std::string where = "--align-by gps";
  for (const Traversal* one : {&sibling, &traversal})
    if (one->latitude.empty() || one->longitude.empty())
      throw Error("latitude and longitude of " + one->name + " are not known", where, "align by index or distance");
  Grid grid(tolerance);
  int known_frames = 0;
  for (int frame = 0; frame < traversal.frames; ++frame)
    if (known(traversal, frame)) {
      grid.add(place(traversal, frame), frame);
      ++known_frames;
    }
  if (known_frames == 0)
    throw Error("latitude and longitude of " + traversal.name + " are not known", where, "align by index or distance");
  Path path;
  std::vector<Grid::Near> near;
  for (const int frame : frames) {
    if (!known(sibling, frame))
      throw Error("the position of " + frame_of(sibling, frame) + " is not known", where, "cut with --frames");
    grid.near(place(sibling, frame), near);
    if (near.empty()) {
      double nearest = std::numeric_limits<double>::infinity();
      for (int other = 0; other < traversal.frames; ++other)
        if (known(traversal, other)) nearest = std::min(nearest, metres_apart(traversal, other, sibling, frame));
      throw Error("no frame of " + traversal.name + " within " + rounded(tolerance) + " m of " +
                      frame_of(sibling, frame) + ", the nearest is " + rounded(nearest) + " m away",
                  where, "cut with --frames, or raise --align-within");
    }
    path.add_step(near);
  }
  const std::vector<int> found = path.frames();
  std::size_t steps_back = 0;
  for (std::size_t i = 1; i < found.size(); ++i) steps_back += found[i] < found[i - 1];
  if (steps_back * 10 > found.size())
    spdlog::warn("{}: {} of {} steps of {} go the other way than those of {}: cameras that look ahead see other things",
                 where, steps_back, found.size() - 1, sibling.name, traversal.name);
  return found;
}

void warn_if_apart(const Traversal& sibling, const std::vector<int>& frames, const Traversal& traversal,
                   const std::vector<int>& found, double tolerance) {
  std::vector<double> apart;
  for (std::size_t i = 0; i < found.size(); ++i)
    if (known(sibling, frames[i]) && known(traversal, found[i]))
      apart.push_back(metres_apart(sibling, frames[i], traversal, found[i]));
  if (apart.size() < 2) return;
  const auto metres = [&](int frame) { return sibling.positions[static_cast<std::size_t>(frame)]; };
  const double length = std::abs(metres(frames.back()) - metres(frames.front()));
  const auto middle = apart.begin() + static_cast<std::ptrdiff_t>(apart.size() / 2);
  std::nth_element(apart.begin(), middle, apart.end());
  if (*middle > std::max(tolerance, length / 20))
    spdlog::warn(
        "half of the frames of {} and {} that are taken for the same places are {} m apart or more by latitude "
        "and longitude: one begins elsewhere, runs the other way, or has its columns exchanged",
        sibling.name, traversal.name, rounded(*middle));
}

}  // namespace citylearn
