// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <string>

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
/// Returns what GET /api/map/HASH answers.
nlohmann::json map_json(std::uint64_t hash, const RouteMap& map);

}  // namespace citylearn
