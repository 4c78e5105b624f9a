// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>

namespace citylearn {

enum class Lines { kOne, kAny };  ///< kAny: line feeds and tabs are allowed

/// Returns whether a text has control characters (those of ASCII) but `allowed` ones.
bool has_control(std::string_view text, std::string_view allowed = "");

/// Returns the text of a member of a JSON object that a client sent; nothing when it is missing or null. Throws Error
/// naming the member when it is of another type, longer than `longest` bytes, or has control characters (but those of
/// `lines`).
std::optional<std::string> text_member(const nlohmann::json& object, const char* name, std::size_t longest,
                                       Lines lines = Lines::kOne);

}  // namespace citylearn
