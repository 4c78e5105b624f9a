// SPDX-License-Identifier: Apache-2.0
#include "dashboard/http/target.h"

#include <charconv>
#include <nlohmann/json.hpp>

#include "core/files/json.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

constexpr std::size_t kMaxTopics = 64, kMaxTopicLength = 512;  // IDs of runs are long

std::optional<std::string> decoded(std::string_view text, bool plus_is_space) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%') {
      if (i + 2 >= text.size()) return std::nullopt;
      const char* const digits = text.data() + i + 1;
      unsigned byte = 0;
      if (std::from_chars(digits, digits + 2, byte, 16).ptr != digits + 2) return std::nullopt;
      out += static_cast<char>(byte);
      i += 2;
    } else {
      out += plus_is_space && text[i] == '+' ? ' ' : text[i];
    }
  }
  if (!is_utf8(out)) return std::nullopt;
  return out;
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
  for (const std::string_view part : split(std::string_view(target.path).substr(1), '/')) {
    const auto segment = decoded(part, false);
    if (!segment) return std::nullopt;
    target.segments.push_back(*segment);
  }
  if (question == std::string_view::npos) return target;
  for (const std::string_view part : split(text.substr(question + 1), '&')) {
    if (part.empty()) continue;
    const std::size_t equals = part.find('=');
    const auto name = decoded(part.substr(0, equals), true);
    const auto value = decoded(equals == std::string_view::npos ? "" : part.substr(equals + 1), true);
    if (!name || !value) return std::nullopt;
    if (!target.parameters.emplace(*name, *value).second) target.repeated = *name;
  }
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
