// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "core/util/types.h"
#include "dashboard/http/answer.h"
#include "dashboard/store/rows.h"
#include "dashboard/store/store.h"

namespace citylearn {

// What the API and the live topics send alike (docs/reference/dashboard-api.md).

/// Returns the values of a vector or a text as they lie in memory, for a payload.
template <class Values>
Bytes bytes_of(const Values& values) {
  const auto bytes = std::as_bytes(std::span(values));
  return {bytes.begin(), bytes.end()};
}

/// Returns 16 hexadecimal digits.
std::string hash_text(std::uint64_t hash);
nlohmann::json event_json(const Event& event);
nlohmann::json traversal_json(const TraversalRow& traversal);
/// A part of a map, and how many of its frames are sent at most.
struct MapPart {
  std::uint32_t first = 0, last = std::numeric_limits<std::uint32_t>::max();
  std::uint32_t points = 8192;
};
/// Returns the frames of a part that show best how the route runs: the first and the last one, and of as many equally
/// long pieces as there is room for the frame by which the way from the piece's begin to its end is longest.
std::vector<std::uint32_t> outline(const RouteMap& map, const MapPart& part);
/// Returns what GET /api/map/HASH answers.
nlohmann::json map_json(std::uint64_t hash, const RouteMap& map, const MapPart& part);

}  // namespace citylearn
