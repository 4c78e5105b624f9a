// SPDX-License-Identifier: Apache-2.0
#include "env_service/streets/drive_streets.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "core/util/error.h"
#include "env_service/geometry/plane.h"
#include "env_service/streets/street_graph.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxMeetings = 20;                         // that a description names
constexpr double kMinReach = 1, kMaxReach = 8, kReachSteps = 4;  // metres, and usual steps of the drive
constexpr int kNeighbours = 64;    // steps before and after one that may tell its direction
constexpr double kMinStep = 0.25;  // of the usual one: a vehicle that gets on less stands
constexpr double kMaxSteps = 10;   // usual steps: over a longer gap the way is not known, so that nothing meets it
constexpr double kHeights = 4;     // metres: what is farther above or below is on a bridge
constexpr double kReceiverHeights = 10;
constexpr double kBend = 4;            // times the reach
constexpr double kStay = 1.5;          // times the reach, within which a drive stays where it is on its earlier way
const double kAlong = std::sqrt(0.5);  // cosine of directions that are one

using PlaneVector = std::complex<double>;  // metres to the east and to the north

double dot(PlaneVector a, PlaneVector b) { return (std::conj(a) * b).real(); }
double cross(PlaneVector a, PlaneVector b) { return (std::conj(a) * b).imag(); }

class DriveReader {
 public:
  DriveReader(const Drive& drive, const std::string& where) : where_(where), receiver_(drive.receiver > 0) {
    streets_.frames = static_cast<int>(drive.east.size());
    streets_.places.assign(drive.east.size(), -1);
    choose_steps(drive);
    find_directions();
    join();
    find_meetings();
    link();
    if (streets_.map.links() == 0)
      throw Error(fmt::format("never crosses its earlier way, nor runs along it within {:.1f} m", streets_.reach),
                  where_, "it is a line: leave out --rule");
  }
  DriveStreets streets() { return std::move(streets_); }

 private:
  /// A frame where the vehicle got on.
  struct Step {
    int frame, drive;
    PlaneVector at;
    double height, along;        ///< metres; the height may be unknown
    PlaneVector direction = {};  ///< of length 1
    int merged = -1;             ///< the earlier step along whose way this one is
    int crossing = -1;           ///< the earlier step with which this one is one place

    Point point() const { return {at.real(), at.imag()}; }
  };

  Step& step(int index) { return steps_[static_cast<std::size_t>(index)]; }
  int count() const { return static_cast<int>(steps_.size()); }
  double metres(int a, int b) { return std::abs(step(a).at - step(b).at); }
  bool one_drive(int a, int b) { return step(a).drive == step(b).drive; }
  /// Returns how far a drive has gone since an earlier step, which may be another drive's.
  double back(int now, int then) { return one_drive(now, then) ? step(now).along - step(then).along : INFINITY; }
  int place(int index) {
    while (step(index).crossing >= 0) index = step(index).crossing;
    return index;
  }
  /// Returns the step of an earlier way that this one is on, or itself.
  int on(int index) { return step(index).merged < 0 ? index : step(index).merged; }
  /// Returns how far it is from a step to its neighbours; 0 over gaps.
  double gap(int index) {
    double most = 0;
    for (const int other : {std::max(index - 1, 0), std::min(index + 1, count() - 1)})
      if (one_drive(index, other) && metres(index, other) <= kMaxSteps * usual_)
        most = std::max(most, metres(index, other));
    return most;
  }
  bool one_height(int a, int b, bool crosses) {
    const double apart = std::abs(step(a).height - step(b).height);
    return receiver_ ? !(crosses && one_drive(a, b) && apart > kReceiverHeights) : !(apart > kHeights);
  }

  void choose_steps(const Drive& drive) {
    std::vector<double> moves;
    for (std::size_t i = 0, next = 0; i < drive.east.size(); ++i) {
      while (next < drive.begins.size() && drive.begins[next] <= static_cast<int>(i)) ++next;
      if (!std::isfinite(drive.east[i] + drive.north[i] + drive.along[i])) {
        ++streets_.unknown;
        continue;
      }
      const bool first = steps_.empty() || steps_.back().drive != static_cast<int>(next);
      const double moved = first ? 0 : drive.along[i] - steps_.back().along;
      if (moved > 0) moves.push_back(moved);
      steps_.push_back({static_cast<int>(i),
                        static_cast<int>(next),
                        {drive.east[i], drive.north[i]},
                        drive.height.empty() ? 0 : drive.height[i],
                        drive.along[i]});
    }
    if (moves.empty()) throw Error("stands, or fewer than two of its frames have places", where_, "leave out --rule");
    const auto middle = moves.begin() + static_cast<std::ptrdiff_t>(moves.size() / 2);
    std::nth_element(moves.begin(), middle, moves.end());
    usual_ = *middle;
    streets_.reach = std::max(drive.receiver, std::clamp(kReachSteps * usual_, kMinReach, kMaxReach));
    const double least = kMinStep * usual_;
    std::erase_if(steps_, [&, last = std::optional<Step>()](const Step& one) mutable {
      if (last && last->drive == one.drive && (one.along - last->along < least || std::abs(one.at - last->at) < least))
        return true;
      last = one;
      return false;
    });
  }

  /// Takes directions from places a quarter of the reach away on both sides, as those of neighbours are noisy.
  void find_directions() {
    for (int i = 0; i < count(); ++i) {
      int before = i, after = i;
      const auto goes_on = [&](int from, int to) {
        return to >= 0 && to < count() && one_drive(i, to) && std::abs(to - i) <= kNeighbours &&
               metres(from, i) < streets_.reach / 4;
      };
      while (goes_on(before, before - 1)) --before;
      while (goes_on(after, after + 1)) ++after;
      const PlaneVector way = step(after).at - step(before).at;
      step(i).direction = way == PlaneVector() ? PlaneVector(0, 1) : way / std::abs(way);
    }
  }

  /// Finds which steps are on the earlier way.
  void join() {
    double side = kStay * streets_.reach;
    for (int i = 0; i < count(); ++i) side = std::max(side, gap(i));
    side *= 2;  // a way crosses another one at most a gap from its steps
    Grid grid(side);
    std::vector<Grid::Near> near;
    for (int i = 0; i < count(); ++i) {
      Step& now = step(i);
      grid.near(now.point(), near);
      const bool goes_on = i > 0 && one_drive(i, i - 1);
      const double reach = streets_.reach * (goes_on && step(i - 1).merged >= 0 ? kStay : 1);
      double least = side;
      for (const auto& [other, metres] : near) {
        const Step& earlier = step(other);
        const double cosine = dot(now.direction, earlier.direction);
        const PlaneVector away = now.at - earlier.at;
        if (std::abs(cosine) < kAlong || back(i, other) <= (cosine > 0 ? kBend : 1) * streets_.reach ||
            !one_height(i, other, false) || std::abs(cross(earlier.direction, away)) > reach ||
            std::abs(dot(earlier.direction, away)) > std::max(gap(other), usual_) || metres >= least)
          continue;
        least = metres;
        now.merged = other;
      }
      if (goes_on) cross_earlier(i, near);
      if (now.merged < 0) grid.add(now.point(), i);
    }
  }

  /// Joins the way to step i, where it crosses those near, with them.
  void cross_earlier(int i, const std::vector<Grid::Near>& near) {
    const PlaneVector from = step(i - 1).at, way = step(i).at - from;
    for (const auto& [other, away] : near) {
      if (other + 1 >= i || !one_drive(other, other + 1) || step(other + 1).merged >= 0 ||
          back(i, other + 1) <= kBend * streets_.reach)
        continue;
      const PlaneVector start = step(other).at, earlier = step(other + 1).at - start;
      const double across = cross(way, earlier);
      if (std::max(std::abs(way), std::abs(earlier)) > kMaxSteps * usual_ ||
          std::abs(dot(way, earlier)) >= kAlong * std::abs(way) * std::abs(earlier))
        continue;
      const double share = cross(start - from, earlier) / across, there = cross(start - from, way) / across;
      if (share < 0 || share > 1 || there < 0 || there > 1) continue;
      const int then = there < 0.5 ? other : other + 1;
      const auto on_it = [&](int at) { return one_drive(at, then) && std::abs(at - then) <= 1; };
      if (on_it(on(i - 1)) || on_it(on(i))) continue;
      for (const int now : {share < 0.5 ? i - 1 : i, share < 0.5 ? i : i - 1})
        if (then < now && step(now).merged < 0 && step(now).crossing < 0 && one_height(now, then, true)) {
          step(now).crossing = then;
          break;
        }
    }
  }

  void find_meetings() {
    for (int i = 0, before = -1, first = 0; i < count(); before = step(i++).merged) {
      const int other = std::max(step(i).merged, step(i).crossing);
      if (other < 0) continue;
      if (before >= 0 && !(one_drive(i, i - 1) && one_drive(other, before))) before = -1;
      const int passed = std::abs(other - before);
      if (step(i).merged < 0 || before < 0 || (passed > 3 && passed * usual_ > 2 * streets_.reach)) {
        first = i;
        streets_.meetings.push_back({step(i).frame, 0, step(other).frame});
      }
      DriveMeeting& meeting = streets_.meetings.back();
      meeting.last = step(i).frame;
      meeting.earlier_last = step(other).frame;
      const Step& middle = step((first + i) / 2);
      const double cosine = dot(middle.direction, step(std::max(middle.merged, middle.crossing)).direction);
      meeting.degrees = std::acos(std::clamp(cosine, -1.0, 1.0)) / kDegree;
    }
  }

  /// Makes links between places as the drive went, and keeps those of the largest part.
  void link() {
    std::map<std::pair<int, int>, int> links;  // the places at their ends, and the step that shows them
    for (int i = 1, at = 0, seen = 0; i < count(); ++i) {
      const int to = on(i), way = to > at ? 1 : -1;
      if (!one_drive(i, i - 1)) {
        at = to;
        seen = i;
      }
      if (to == at || (step(i).merged >= 0 && dot(step(to).at - step(at).at, step(i).direction) <= 0)) continue;
      // A drive with longer steps passes places of the earlier way, which it is on all the same.
      bool along = one_drive(to, at) && std::abs(step(to).along - step(at).along) <= kStay * metres(to, at) + usual_;
      for (int between = at; along && between != to; between += way) along = step(between + way).merged < 0;
      for (int next; at != to; at = next) {
        next = along ? at + way : to;
        if (place(at) != place(next)) links.emplace(std::pair(place(at), place(next)), seen);
      }
      seen = i;
    }
    std::vector<std::pair<int, int>> ends;
    for (const auto& link : links) ends.push_back(link.first);
    const std::vector<bool> strong = largest_strong_part(steps_.size(), ends);
    const auto kept = [&](int at) { return strong[static_cast<std::size_t>(at)]; };
    std::vector<int> index(steps_.size(), -1), shown;
    StreetMap& map = streets_.map;
    for (int i = 0; i < count(); ++i) {
      if (on(i) != i || place(i) != i || !kept(i)) continue;
      index[static_cast<std::size_t>(i)] = static_cast<int>(map.places());
      map.east.push_back(static_cast<float>((step(i).at - step(0).at).real()));
      map.north.push_back(static_cast<float>((step(i).at - step(0).at).imag()));
    }
    const auto at = [&](int i) { return index[static_cast<std::size_t>(place(on(i)))]; };
    for (const auto& [two, seen] : links) {
      if (!kept(two.first) || !kept(two.second)) continue;
      map.from.push_back(static_cast<std::uint32_t>(at(two.first)));
      map.to.push_back(static_cast<std::uint32_t>(at(two.second)));
      map.heading.push_back(static_cast<float>(90 - std::arg(step(seen).direction) / kDegree));
      shown.push_back(step(seen).frame);
    }
    if (map.links() == 0) return;
    for (const std::uint32_t link : map.put_in_order()) streets_.shown.push_back(shown[link]);
    for (int i = 0; i < count(); ++i) {
      streets_.places[static_cast<std::size_t>(step(i).frame)] = at(i);
      streets_.apart += at(i) < 0;
    }
  }

  const std::string where_;
  const bool receiver_;
  double usual_ = 0;  // metres between steps
  std::vector<Step> steps_;
  DriveStreets streets_;
};

}  // namespace

std::vector<std::string> DriveStreets::description() const {
  std::vector<std::pair<int, int>> links;
  for (std::size_t link = 0; link < map.links(); ++link)
    links.emplace_back(static_cast<int>(map.from[link]), static_cast<int>(map.to[link]));
  std::vector<std::string> lines{
      fmt::format("{}; frames left out: {}, of which {} are at places that cannot be reached from the others, or not "
                  "left for them, and {} at unknown places",
                  count_streets(map.places(), links),
                  frames - static_cast<int>(std::set<int>(shown.begin(), shown.end()).size()), apart, unknown)};
  for (std::size_t i = 0; i < std::min(meetings.size(), kMaxMeetings); ++i) {
    const DriveMeeting& one = meetings[i];
    const std::string line = one.first == one.last
                                 ? fmt::format("frame {} meets frame {}", one.first, one.earlier_first)
                                 : fmt::format("frames {} to {} run along frames {} to {}", one.first, one.last,
                                               one.earlier_first, one.earlier_last);
    lines.push_back(fmt::format("streets: {} ({:.0f} degrees)", line, one.degrees));
  }
  if (meetings.size() > kMaxMeetings)
    lines.push_back(fmt::format("streets: and {} more meetings", meetings.size() - kMaxMeetings));
  return lines;
}

DriveStreets streets_of(const Drive& drive, const std::string& where) { return DriveReader(drive, where).streets(); }

}  // namespace citylearn
