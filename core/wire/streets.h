// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "core/task/street_map.h"
#include "core/util/types.h"

namespace citylearn {

/// Returns the bytes of the object Streets that holds a map.
Bytes encode_streets(const StreetMap& map);
/// Returns the map that an object Streets holds. Throws Error unless it is in order and has this hash, where one is
/// given.
StreetMap decode_streets(const Bytes& bytes, std::optional<std::uint64_t> hash = {});

}  // namespace citylearn
