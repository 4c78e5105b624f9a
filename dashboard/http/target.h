// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// The parsed target of a request's first line.
struct Target {
  std::string path;                               ///< as sent: "/api/runs/a%2Fb"
  std::vector<std::string> segments;              ///< percent-decoded: {"api", "runs", "a/b"}; {""} for "/"
  std::map<std::string, std::string> parameters;  ///< of the query string, percent-decoded; '+' is a space
  std::string repeated;                           ///< a parameter that is given twice; or empty
};

/// Returns nothing for a text that is not an absolute path, or is not UTF-8 without zero bytes.
std::optional<Target> parse_target(std::string_view text);

/// Returns the topics in a client's message {"watch": [at most 64 topics]} to /api/live; nothing for other texts.
std::optional<std::set<std::string>> parse_watch(const std::string& text);

/// Returns whether `text` is well-formed UTF-8 without zero bytes (RFC 3629: no overlong forms, no surrogates).
bool is_utf8(std::string_view text);

}  // namespace citylearn
