// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/target.h"

#include <nlohmann/json.hpp>

#include "core/files/json.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxTopics = 64, kMaxTopicLength = 512;  // IDs of runs are long

int hex_digit(char c) {
  if (c >= '0' && c <= '9') return c - '0';
  if (c >= 'a' && c <= 'f') return c - 'a' + 10;
  if (c >= 'A' && c <= 'F') return c - 'A' + 10;
  return -1;
}

std::optional<std::string> decoded(std::string_view text, bool plus_is_space) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%') {
      if (i + 2 >= text.size()) return std::nullopt;
      const int high = hex_digit(text[i + 1]), low = hex_digit(text[i + 2]);
      if (high < 0 || low < 0) return std::nullopt;
      out += static_cast<char>(high * 16 + low);
      i += 2;
    } else {
      out += plus_is_space && text[i] == '+' ? ' ' : text[i];
    }
  }
  if (!is_utf8(out)) return std::nullopt;
  return out;
}

/// Calls `use` with each part between `separator`s until it returns false.
template <class Use>
bool for_each_part(std::string_view text, char separator, Use use) {
  for (;;) {
    const std::size_t end = text.find(separator);
    if (!use(text.substr(0, end))) return false;
    if (end == std::string_view::npos) return true;
    text.remove_prefix(end + 1);
  }
}

}  // namespace

bool is_utf8(std::string_view text) {
  if (text.find('\0') != text.npos) return false;
  try {
    nlohmann::json(text).dump();
  } catch (const nlohmann::json::type_error&) {
    return false;
  }
  return true;
}

std::optional<Target> parse_target(std::string_view text) {
  if (text.empty() || text[0] != '/') return std::nullopt;
  text = text.substr(0, text.find('#'));
  const std::size_t question = text.find('?');
  Target target;
  target.path = text.substr(0, question);
  const bool path = for_each_part(std::string_view(target.path).substr(1), '/', [&](std::string_view part) {
    auto segment = decoded(part, false);
    if (segment) target.segments.push_back(std::move(*segment));
    return segment.has_value();
  });
  if (!path) return std::nullopt;
  if (question == std::string_view::npos) return target;
  const bool query = for_each_part(text.substr(question + 1), '&', [&](std::string_view part) {
    if (part.empty()) return true;
    const std::size_t equals = part.find('=');
    const auto name = decoded(part.substr(0, equals), true);
    const auto value = decoded(equals == std::string_view::npos ? "" : part.substr(equals + 1), true);
    return name && value && target.parameters.emplace(*name, *value).second;
  });
  if (!query) return std::nullopt;
  return target;
}

std::optional<std::set<std::string>> parse_watch(const std::string& text) {
  const auto said = parse_json_or_null(text);
  if (!said.is_object() || !said.contains("watch") || !said["watch"].is_array()) return std::nullopt;
  if (said["watch"].size() > kMaxTopics) return std::nullopt;
  std::set<std::string> topics;
  for (const auto& topic : said["watch"]) {
    if (!topic.is_string() || topic.get_ref<const std::string&>().size() > kMaxTopicLength) return std::nullopt;
    topics.insert(topic.get<std::string>());
  }
  return topics;
}

}  // namespace citylearn
