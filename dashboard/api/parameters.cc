// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/parameters.h"

#include <algorithm>

#include "core/util/text.h"

namespace citylearn {

void not_found(const std::string& what) { throw RequestError(404, what); }

void allow_only(const Query& query, std::initializer_list<const char*> known) {
  for (const auto& [name, value] : query.parameters)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw RequestError(400, "parameter '" + name + "' is not known here (" +
                                  (known.size() == 0 ? "there are none" : joined(known)) + ")");
}

std::optional<std::string> text_parameter(const Query& query, const char* name) {
  const auto found = query.parameters.find(name);
  return found == query.parameters.end() ? std::nullopt : std::optional(found->second);
}

std::optional<bool> flag_parameter(const Query& query, const char* name) {
  const auto text = text_parameter(query, name);
  if (text && *text != "0" && *text != "1")
    throw RequestError(400, "parameter '" + std::string(name) + "' must be 0 or 1, is '" + *text + "'");
  return text ? std::optional(*text == "1") : std::nullopt;
}

std::uint64_t parsed_hash(const std::string& text) {
  std::uint64_t hash = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), hash, 16);
  if (text.size() != 16 || fault != std::errc() || end != text.data() + text.size() ||
      text.find_first_of("ABCDEF") != text.npos)
    throw RequestError(400, "a hash has 16 hexadecimal digits, '" + text + "' has not");
  return hash;
}

}  // namespace citylearn
