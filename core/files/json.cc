// SPDX-License-Identifier: Apache-2.0
#include "core/files/json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "core/util/error.h"

namespace citylearn {
namespace {

/// Returns whether the brackets outside of strings nest too deep, whatever else is wrong with the text.
bool nests_too_deep(std::string_view text) {
  std::size_t levels = 0;
  bool quoted = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (quoted && c == '\\')
      ++i;
    else if (c == '"')
      quoted = !quoted;
    else if (!quoted && (c == '[' || c == '{'))
      ++levels;
    else if (!quoted && (c == ']' || c == '}') && levels > 0)
      --levels;
    if (levels > kMaxJsonDepth) return true;
  }
  return false;
}

}  // namespace

template <class Json>
Json parse_json(std::string_view text, const std::string& where, const std::string& remedy,
                const std::vector<std::string>& without) {
  if (nests_too_deep(text))
    throw Error("nests more than " + std::to_string(kMaxJsonDepth) + " levels deep", where, remedy);
  try {
    if (without.empty()) return Json::parse(text);
    return Json::parse(text, [&](int, typename Json::parse_event_t event, Json& value) {
      return event != Json::parse_event_t::key ||
             std::find(without.begin(), without.end(), value.template get_ref<const std::string&>()) == without.end();
    });
  } catch (const nlohmann::json::parse_error& error) {
    throw Error("is not JSON: broken at byte " + std::to_string(error.byte), where, remedy);
  } catch (const nlohmann::json::exception&) {
    throw Error("holds a number that is too large", where, remedy);
  }
}

template <class Json>
Json parse_json_or_null(std::string_view text) {
  try {
    return parse_json<Json>(text, "");
  } catch (const Error&) {
    return nullptr;
  }
}

using nlohmann::json;
using nlohmann::ordered_json;
template json parse_json(std::string_view, const std::string&, const std::string&, const std::vector<std::string>&);
template ordered_json parse_json(std::string_view, const std::string&, const std::string&,
                                 const std::vector<std::string>&);
template json parse_json_or_null(std::string_view);
template ordered_json parse_json_or_null(std::string_view);

}  // namespace citylearn
