// SPDX-License-Identifier: Apache-2.0
#include "street_views.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/util/error.h"
#include "core/wire/messages.h"
#include "env_service/files/files.h"
#include "env_service/geometry/plane.h"
#include "env_service/images/image_sources.h"

namespace citylearn {
namespace {

constexpr double kReceiver = 5;   // metres by which receivers err
constexpr double kOrigin = 0.01;  // metres

/// Returns whether some place of each recording is known.
bool known_of_each(const Traversal& recording, const std::vector<double>& places) {
  if (places.empty()) return false;
  std::vector<int> begins = recording.begins;
  if (begins.empty()) begins.push_back(0);
  begins.push_back(recording.frames);
  for (std::size_t i = 0; i + 1 < begins.size(); ++i)
    if (std::none_of(places.begin() + begins[i], places.begin() + begins[i + 1], [](double at) { return at == at; }))
      return false;
  return true;
}

/// Throws Error where a plane is not that of all recordings: odometry begins at 0, 0 wherever it is.
void require_one_plane(const Traversal& recording, const std::string& where) {
  const std::string remedy = "join recordings with latitude and longitude, or in one plane";
  if (!known_of_each(recording, recording.x))
    throw Error("one of them has no latitude and longitude, and one no places in a plane", where, remedy);
  if (std::all_of(recording.begins.begin(), recording.begins.end(), [&](int frame) {
        return std::hypot(recording.x[static_cast<std::size_t>(frame)], recording.y[static_cast<std::size_t>(frame)]) <
               kOrigin;
      }))
    throw Error("each begins at 0, 0 of a plane of its own", where, remedy);
}

}  // namespace

void set_streets(Traversal& traversal, const StreetGraph& graph, std::shared_ptr<const StreetMap> map, StateRule rule,
                 const StateMap& states) {
  traversal.streets = std::move(map);
  traversal.rule = rule;
  traversal.positions.assign(static_cast<std::size_t>(states.states()), std::numeric_limits<float>::quiet_NaN());
  traversal.latitude.clear();
  traversal.longitude.clear();
  for (int state = 0; state < states.states(); ++state) {
    const StreetPlace& place = graph.places()[static_cast<std::size_t>(states.place(state))];
    traversal.latitude.push_back(place.latitude);
    traversal.longitude.push_back(place.longitude);
  }
}

void show_states(Traversal& traversal, const StreetGraph& graph, std::optional<StateRule> rule,
                 const std::string& where) {
  std::vector<std::uint32_t> rows;
  const auto map = std::make_shared<const StreetMap>(graph.map(rows));
  const auto frames = static_cast<std::size_t>(traversal.frames), fixed = map->places() * StateMap::kHeadings;
  const bool by_link = frames == map->links() && rule.value_or(StateRule::kStreet) == StateRule::kStreet;
  const bool by_heading = frames == fixed && rule != StateRule::kStreet, by_place = frames == map->places();
  if (!by_link && !by_heading && !by_place) {
    const std::string what =
        fmt::format("has {} frames, where the map has {} links, and {} places with 16 headings each, {} in all", frames,
                    map->links(), map->places(), fixed);
    if (rule) throw Error(what, where, "give a frame for each of these that the rule has, or --rule line");
    spdlog::warn("{}: {}: it is walked as a line", where, what);
    return;
  }
  const StateRule by = rule.value_or(by_heading ? StateRule::kStreetFixed : StateRule::kStreet);
  const StateMap states(*map, by, msg::MAX_FRAMES);
  if (const std::string name = traversal.images ? traversal.images->name(0) : "";
      graph.find(stem_of(name.substr(name.rfind('/') + 1))) >= 0)
    throw Error("its pictures have the names of places", where, "put panoramas into panos/, for dataset streetlearn");
  spdlog::info("{}: a frame for each {} of a map of streets with {} places and {} links", where,
               by_link      ? "link"
               : by_heading ? "heading"
                            : "place, the same at each heading,",
               map->places(), map->links());
  std::vector<int> shown;
  for (int state = 0; state < states.states(); ++state)
    shown.push_back(by_link      ? static_cast<int>(rows[static_cast<std::size_t>(state)])
                    : by_heading ? state
                                 : states.place(state));
  if (traversal.images) traversal.images = picked(traversal.images, shown);
  traversal.keep(shown);
  set_streets(traversal, graph, map, by, states);
  traversal.times.clear();
}

DriveStreets streets_driven(const Traversal& recording, const std::string& where) {
  Drive drive{recording.x, recording.y, recording.height, recording.positions};
  drive.begins = recording.begins;
  const bool in_plane = known_of_each(recording, recording.x), on_earth = known_of_each(recording, recording.latitude);
  if (recording.begins.size() > 1 && !on_earth) require_one_plane(recording, where);
  if (on_earth && (!in_plane || recording.begins.size() > 1)) {
    // A sphere laid flat at the first known place is right enough where the drive meets itself.
    drive.receiver = kReceiver;
    drive.east = drive.north = recording.latitude;
    double latitude = std::nan(""), longitude = std::nan("");
    for (std::size_t i = 0; i < recording.latitude.size(); ++i) {
      if (std::isnan(longitude)) latitude = recording.latitude[i], longitude = recording.longitude[i];
      drive.east[i] = kEarthRadius * kDegree * std::cos(latitude * kDegree) *
                      std::remainder(recording.longitude[i] - longitude, 360);
      drive.north[i] = kEarthRadius * kDegree * (recording.latitude[i] - latitude);
    }
  }
  if (drive.east.empty())
    throw Error("has neither a map of streets nor places in a plane or on the earth", where, "leave out --rule");
  return streets_of(drive, where);
}

void show_along_links(Traversal& traversal, std::shared_ptr<const StreetMap> map, const std::vector<int>& shown) {
  if (traversal.images) traversal.images = picked(traversal.images, shown);
  traversal.keep(shown);
  traversal.positions.assign(shown.size(), std::numeric_limits<float>::quiet_NaN());
  traversal.times.clear();
  traversal.rule = StateRule::kStreet;
  traversal.streets = std::move(map);
}

}  // namespace citylearn
