// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

#include "dashboard/store/rows.h"
#include "dashboard/store/store.h"

namespace citylearn {

// What the API and the live topics send alike (docs/reference/dashboard-api.md).

/// Returns 16 hexadecimal digits.
std::string hash_text(std::uint64_t hash);
nlohmann::json event_json(const Event& event);
nlohmann::json traversal_json(const TraversalRow& traversal);

}  // namespace citylearn
