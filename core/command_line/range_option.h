// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <CLI/CLI.hpp>
#include <charconv>
#include <string>
#include <string_view>

namespace citylearn {

/// Parses "A:B", the value of an option. Either may be left out; `from` and `to` then stay as they are. Throws
/// CLI::ValidationError when it is not such a range, or an empty one.
template <class Number>
void read_range(const std::string& option, const std::string& text, Number& from, Number& to) {
  const std::size_t colon = text.find(':');
  const auto read = [&](std::string_view part, Number& number) {
    if (part.empty()) return;
    const auto [end, error] = std::from_chars(part.data(), part.data() + part.size(), number);
    if (error != std::errc() || end != part.data() + part.size())
      throw CLI::ValidationError(option, "'" + std::string(part) + "' is not a number");
  };
  if (colon == text.npos || text.size() == 1)
    throw CLI::ValidationError(option, "'" + text + "' is not a range FROM:TO, of which one may be left out");
  read(std::string_view(text).substr(0, colon), from);
  read(std::string_view(text).substr(colon + 1), to);
  if (!(from < to)) throw CLI::ValidationError(option, "'" + text + "' is an empty range");
}

}  // namespace citylearn
