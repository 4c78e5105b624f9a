// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/text_member.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/util/error.h"

namespace citylearn {

bool has_control(std::string_view text, std::string_view allowed) {
  return std::any_of(text.begin(), text.end(),
                     [&](char c) { return ((c >= 0 && c < ' ') || c == '\x7F') && allowed.find(c) == allowed.npos; });
}

std::optional<std::string> text_member(const nlohmann::json& object, const char* name, std::size_t longest,
                                       Lines lines) {
  const auto member = object.find(name);
  if (member == object.end() || member->is_null()) return std::nullopt;
  const auto* text = member->get_ptr<const std::string*>();
  if (!text || text->size() > longest || has_control(*text, lines == Lines::kAny ? "\n\t" : ""))
    throw Error("'" + std::string(name) + "' must be " + (lines == Lines::kAny ? "a text" : "one line") +
                " of at most " + std::to_string(longest) + " bytes without control characters");
  return *text;
}

}  // namespace citylearn
