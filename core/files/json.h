// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// The deepest nesting of JSON that is read. Copying and writing a value uses the stack for each level, and a text of a
/// few kilobytes can have as many levels as bytes.
inline constexpr std::size_t kMaxJsonDepth = 64;

/// Returns the value of a JSON text; every text of a file, a message or a client is read by this function. Members of
/// objects whose names are in `without` are left out, which saves memory. Throws Error with `where` and `remedy` when
/// the text is not JSON (it says at which byte), nests too deep or has a number that is too large. `Json` is
/// nlohmann::json or nlohmann::ordered_json.
template <class Json = nlohmann::json>
Json parse_json(std::string_view text, const std::string& where, const std::string& remedy = "",
                const std::vector<std::string>& without = {});

/// Returns null for a text that parse_json() refuses.
template <class Json = nlohmann::json>
Json parse_json_or_null(std::string_view text);

}  // namespace citylearn
