// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <charconv>
#include <cstdint>
#include <exception>
#include <initializer_list>
#include <optional>
#include <string>

#include "core/util/error.h"
#include "dashboard/http/answer.h"

namespace citylearn {

/// The error of a request, which Api::answer() returns as the answer to it.
class RequestError : public std::exception {
 public:
  RequestError(int status, const std::string& what) : answer(error_answer(status, what)) {}
  const char* what() const noexcept override { return answer.body.c_str(); }
  Answer answer;
};

[[noreturn]] void not_found(const std::string& what);

/// Appends a number; of a float the shortest text that is this float: 0.9, not 0.899999976.
template <class Number>
void append_number(std::string& text, Number value) {
  char digits[32];
  const auto end = std::to_chars(digits, digits + sizeof digits, value).ptr;
  text.append(digits, static_cast<std::size_t>(end - digits));
}

/// Returns nothing unless all of `text` is a number of this type.
template <class Number>
std::optional<Number> parsed(const std::string& text) {
  Number number{};
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (fault != std::errc() || end != text.data() + text.size() || text.empty()) return std::nullopt;
  return number;
}

// Parameters of a query. All throw RequestError for what is not allowed.

/// Checks that the query has no parameters but these.
void allow_only(const Query& query, std::initializer_list<const char*> known);

/// Returns a parameter, or nothing when it is not given.
std::optional<std::string> text_parameter(const Query& query, const char* name);

template <class Number>
std::optional<Number> number_parameter(const Query& query, const char* name, Number least, Number most) {
  const auto text = text_parameter(query, name);
  if (!text) return std::nullopt;
  const auto value = parsed<Number>(*text);
  if (!value || !(*value >= least && *value <= most)) {
    std::string range;
    append_number(range, least);
    range += "..";
    append_number(range, most);
    throw RequestError(400, "parameter '" + std::string(name) + "' must be a number " + range + ", is '" + *text + "'");
  }
  return value;
}

/// "0" or "1".
std::optional<bool> flag_parameter(const Query& query, const char* name);

/// Returns the number of a hash of 16 hexadecimal digits in lower case.
std::uint64_t parsed_hash(const std::string& text);

}  // namespace citylearn
