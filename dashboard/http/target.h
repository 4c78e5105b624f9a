// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// What a request asks for: the target of its first line, taken apart.
struct Target {
  std::string path;                               ///< as it was sent: "/api/runs/a%2Fb"
  std::vector<std::string> segments;              ///< percent-decoded: {"api", "runs", "a/b"}; {""} for "/"
  std::map<std::string, std::string> parameters;  ///< of the query string, percent-decoded; '+' is a space
};

/// Nothing where `text` is no absolute path, or what its percent signs say is no UTF-8, or holds a zero byte, or a
/// parameter is there twice.
std::optional<Target> parse_target(std::string_view text);

/// What a client of /api/live wants to hear of: {"watch": [at most 64 topics]}. Nothing where `text` is something else.
std::optional<std::set<std::string>> parse_watch(const std::string& text);

/// Well-formed UTF-8 without zero bytes (RFC 3629: no overlong forms, no surrogates).
bool is_utf8(std::string_view text);

}  // namespace citylearn
