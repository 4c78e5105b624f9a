// SPDX-License-Identifier: Apache-2.0
#include "goal_place.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <regex>
#include <vector>

#include "core/task/imperfections.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/files/text_table.h"
#include "env_service/geometry/geometry.h"

namespace citylearn {
namespace {

constexpr double kWithin = 50;  // metres

/// Returns the numbers between commas; none where there is something else.
std::vector<double> numbers_of(const std::string& text) {
  const std::vector<std::string_view> parts = split(text, ',');
  std::vector<double> numbers;
  for (std::size_t i = 0; i < parts.size(); ++i) numbers.push_back(field_number(parts, i));
  if (!std::all_of(numbers.begin(), numbers.end(), [](double x) { return std::isfinite(x); })) numbers.clear();
  return numbers;
}

/// Returns the frame nearest to a position. `place_of` is the place of a frame, for messages.
int frame_at(const Traversal& traversal, double latitude, double longitude, double within,
             const std::function<int(int)>& place_of) {
  if (std::abs(latitude) > 90 || std::abs(longitude) > 180 || !(within > 0))
    throw Error("is not a latitude and a longitude in degrees, and metres around them");
  int nearest = -1;
  double least = INFINITY;
  for (std::size_t frame = 0; frame < traversal.latitude.size(); ++frame) {
    const double away = metres_between(traversal.latitude[frame], traversal.longitude[frame], latitude, longitude);
    if (!(away < least)) continue;  // NaN where it is not known
    least = away;
    nearest = static_cast<int>(frame);
  }
  if (nearest < 0)
    throw Error("latitudes and longitudes of '" + traversal.name + "' are not known", "", "name a place");
  if (least > within)
    throw Error(fmt::format("no place is within {:g} m: the nearest, place {} at {:.6f},{:.6f}, is {:.1f} m away",
                            within, place_of(nearest), traversal.latitude[static_cast<std::size_t>(nearest)],
                            traversal.longitude[static_cast<std::size_t>(nearest)], least));
  return nearest;
}

/// Returns the one frame that shows a picture of this name.
int frame_of(const Traversal& traversal, const std::string& picture) {
  std::vector<int> found;
  for (int frame = 0; traversal.images && frame < traversal.frames; ++frame)
    if (const std::string name = "/" + traversal.images->name(frame); name.ends_with("/" + picture))
      found.push_back(frame);
  if (found.empty()) throw Error("is neither a place's number, nor LAT,LON, nor a picture of '" + traversal.name + "'");
  return found.front();
}

}  // namespace

Traversal with_goal(Traversal traversal, const std::string& goal) try {
  if (goal.empty()) return traversal;
  const auto states = traversal.states();
  const auto place_of = [&](int frame) { return states ? states->place(frame) : frame; };
  const int places = states ? states->places() : traversal.frames;
  const std::vector<double> numbers = numbers_of(goal);
  if (numbers.size() == 1) {
    traversal.goal = static_cast<int>(std::clamp(numbers[0], -1.0, 1e9));
    if (traversal.goal != numbers[0] || traversal.goal < 0 || traversal.goal >= places)
      throw Error(fmt::format("'{}' has the places 0..{}", traversal.name, places - 1));
  } else if (numbers.size() == 2 || numbers.size() == 3) {
    const double within = numbers.size() == 3 ? numbers[2] : kWithin;
    traversal.goal = place_of(frame_at(traversal, numbers[0], numbers[1], within, place_of));
  } else {
    traversal.goal = place_of(frame_of(traversal, goal));
  }
  if (!traversal.unmatched.empty() && traversal.unmatched[static_cast<std::size_t>(traversal.goal)])
    throw Error("'" + traversal.name + "' does not show that place");
  traversal.name = name_in_world(traversal.name, "goal" + std::to_string(traversal.goal));
  return traversal;
} catch (const Error& error) {
  throw Error(error.what(), "--goal-place " + goal);
}

Traversal with_goals(Traversal traversal, int goals) {
  if (goals > 1) traversal.name = name_in_world(traversal.name, "goals" + std::to_string(goals));
  return traversal;
}

std::string without_goal(const std::string& name) {
  static const std::regex kGoal("-goals?\\d+(?=-|$)");
  return std::regex_replace(name, kGoal, "");
}

}  // namespace citylearn
