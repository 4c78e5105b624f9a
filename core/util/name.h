// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace citylearn {

// One rule for the names of services, sessions, traversals, agents and learners, which become fields of files, names of
// folders, parts of addresses and words of log lines: 1 to 64 of A-Z, a-z, 0-9, '.', '_' and '-', not dots alone.

inline constexpr std::size_t kMaxNameLength = 64;

constexpr bool may_be_in_name(char c) {
  return (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '.' || c == '_' || c == '-';
}

constexpr bool is_name(std::string_view text) {
  if (text.size() > kMaxNameLength) return false;
  // Also refuses an empty one. ".." leads elsewhere in a path, and browsers resolve it in an address, however written.
  if (text.find_first_not_of('.') == std::string_view::npos) return false;
  for (const char c : text)
    if (!may_be_in_name(c)) return false;
  return true;
}

/// Returns what is wrong with a name; empty when nothing is.
inline std::string name_problem(const std::string& text) {
  if (is_name(text)) return "";
  return "'" + text.substr(0, kMaxNameLength) + "' must be 1 to " + std::to_string(kMaxNameLength) +
         " of the characters A-Z a-z 0-9 . _ -, not dots alone";
}

/// Returns the name of a recording whose folder or file may be called anything: other characters become '_'.
inline std::string name_from(std::string text) {
  if (text.size() > kMaxNameLength) text.resize(kMaxNameLength);
  for (char& c : text)
    if (!may_be_in_name(c)) c = '_';
  return text;
}

}  // namespace citylearn
