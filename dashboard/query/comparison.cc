// SPDX-License-Identifier: Apache-2.0
#include "dashboard/query/comparison.h"

#include <nlohmann/json.hpp>
#include <set>

#include "core/files/json.h"
#include "core/util/text.h"

namespace citylearn {
namespace {

using Json = nlohmann::json;

std::string leaf_text(const Json& value) {
  if (value.is_array()) return joined(value, leaf_text);
  return value.is_string() ? value.get<std::string>() : value.dump(-1, ' ', false, Json::error_handler_t::replace);
}

void add_leaves(RunFacts& facts, const Json& value, const std::string& name) {
  if (!value.is_object()) {
    facts[name] = leaf_text(value);
    return;
  }
  for (const auto& [key, inner] : value.items()) add_leaves(facts, inner, name.empty() ? key : name + "." + key);
}

}  // namespace

void add_json_leaves(RunFacts& facts, const std::string& object, const std::string& prefix) {
  const Json json = parse_json_or_null(object);
  if (json.is_object()) add_leaves(facts, json, prefix);
}

std::vector<ComparedFact> compare(std::span<const RunFacts> runs) {
  std::set<std::string> keys;
  for (const RunFacts& facts : runs)
    for (const auto& [key, value] : facts) keys.insert(key);
  std::vector<ComparedFact> rows;
  for (const std::string& key : keys) {
    ComparedFact& row = rows.emplace_back();
    row.key = key;
    std::set<std::optional<std::string>> different;
    for (const RunFacts& facts : runs) {
      const auto found = facts.find(key);
      row.values.push_back(found == facts.end() ? std::nullopt : std::optional(found->second));
      if (!facts.empty()) different.insert(row.values.back());
    }
    row.differs = different.size() > 1;
  }
  return rows;
}

}  // namespace citylearn
