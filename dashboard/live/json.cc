// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/json.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace citylearn {
namespace {

/// Returns the values of some frames, rounded to parts of `scale`; null when none is known.
template <class Number>
nlohmann::json numbers(const std::vector<Number>& values, const std::vector<std::uint32_t>& frames, double scale) {
  nlohmann::json all = nlohmann::json::array();
  bool known = false;
  for (const std::uint32_t frame : frames) {
    const double value = frame < values.size() ? values[frame] : std::nan("");
    all.push_back(std::isfinite(value) ? nlohmann::json(std::round(value * scale) / scale) : nlohmann::json());
    known |= std::isfinite(value);
  }
  return known ? all : nlohmann::json();
}

}  // namespace

std::string hash_text(std::uint64_t hash) { return fmt::format("{:016x}", hash); }

nlohmann::json event_json(const Event& event) {
  return {{"time", event.time},
          {"session", event.session},
          {"service", event.service},
          {"kind", event.kind},
          {"text", event.text}};
}

nlohmann::json traversal_json(const TraversalRow& t) {
  return {{"environment", t.environment}, {"dataset", t.dataset},      {"traversal", t.traversal},
          {"condition", t.condition},     {"hash", hash_text(t.hash)}, {"frames", t.frames},
          {"agents", t.agents},           {"images", t.images},        {"streets", t.rule != StateRule::kLine}};
}

std::vector<std::uint32_t> outline(const RouteMap& map, const MapPart& part) {
  std::vector<std::uint32_t> frames;
  if (part.first >= map.frames || part.last < part.first) return frames;
  const std::uint64_t steps = std::min(part.last, map.frames - 1) - part.first;
  const std::uint64_t pieces = std::min<std::uint64_t>(steps, std::max(part.points, 2u) - 1);
  const bool placed = map.latitude.size() == map.frames && map.longitude.size() == map.frames;
  const auto distance = [&](std::uint32_t a, std::uint32_t b) {
    const double north = map.latitude[a] - map.latitude[b], east = map.longitude[a] - map.longitude[b];
    return std::hypot(north, east * std::cos(map.latitude[b] * std::numbers::pi / 180));
  };
  for (std::uint64_t i = 0; i < pieces; ++i) {
    const auto begin = static_cast<std::uint32_t>(part.first + steps * i / pieces);
    const auto end = static_cast<std::uint32_t>(part.first + steps * (i + 1) / pieces);
    std::uint32_t chosen = begin;
    double longest = -1;
    for (std::uint32_t frame = begin; placed && i > 0 && frame < end; ++frame) {
      const double detour = distance(frame, begin) + distance(frame, end);
      // Of a piece that begins or ends at an unknown place, the first known one.
      const double length = std::isfinite(detour) ? detour : std::isfinite(map.latitude[frame]) ? 0 : -1;
      if (length > longest) longest = length, chosen = frame;
    }
    frames.push_back(chosen);
  }
  frames.push_back(static_cast<std::uint32_t>(part.first + steps));
  return frames;
}

namespace {

/// Returns streets for the page. Of each state it has the place and the heading.
nlohmann::json streets_json(const RouteMap& map) {
  const StreetMap& streets = *map.streets;
  const StateMap states(streets, map.rule, map.frames);
  const auto rounded = [](const std::vector<float>& values) {
    nlohmann::json all = nlohmann::json::array();
    for (const float value : values) all.push_back(std::round(value * 10.0) / 10);
    return all;
  };
  nlohmann::json place = nlohmann::json::array(), heading = nlohmann::json::array();
  for (int state = 0; state < states.states(); ++state) {
    place.push_back(states.place(state));
    heading.push_back(std::round(states.heading(state)));
  }
  return {{"east", rounded(streets.east)}, {"north", rounded(streets.north)},
          {"from", streets.from},          {"to", streets.to},
          {"place", std::move(place)},     {"heading", std::move(heading)}};
}

}  // namespace

nlohmann::json map_json(std::uint64_t hash, const RouteMap& map, const MapPart& part) {
  if (map.streets)
    return {{"hash", hash_text(hash)},     {"frames", map.frames}, {"index", nlohmann::json::array()},
            {"position", nullptr},         {"latitude", nullptr},  {"longitude", nullptr},
            {"streets", streets_json(map)}};
  const std::vector<std::uint32_t> frames = outline(map, part);
  constexpr double kMillimetres = 1e3, kMillimetresOfDegrees = 1e8;
  return {{"hash", hash_text(hash)},
          {"frames", map.frames},
          {"index", frames},
          {"position", numbers(map.position, frames, kMillimetres)},
          {"latitude", numbers(map.latitude, frames, kMillimetresOfDegrees)},
          {"longitude", numbers(map.longitude, frames, kMillimetresOfDegrees)},
          {"streets", nullptr}};
}

}  // namespace citylearn
