// SPDX-License-Identifier: Apache-2.0
#include "dashboard/live/json.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

namespace citylearn {
namespace {

template <class Number>
nlohmann::json numbers(const std::vector<Number>& values) {
  nlohmann::json all = nlohmann::json::array();
  for (const Number value : values) all.push_back(std::isfinite(value) ? nlohmann::json(value) : nlohmann::json());
  return all;
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
          {"agents", t.agents},           {"images", t.images}};
}

nlohmann::json map_json(std::uint64_t hash, const RouteMap& map) {
  return {{"hash", hash_text(hash)},
          {"frames", map.frames},
          {"position", numbers(map.position)},
          {"latitude", map.latitude.empty() ? nlohmann::json() : numbers(map.latitude)},
          {"longitude", map.longitude.empty() ? nlohmann::json() : numbers(map.longitude)}};
}

}  // namespace citylearn
