// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/json_file.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "core/util/error.h"
#include "core/util/files.h"
#include "env_service/files/files.h"

namespace citylearn {

using nlohmann::json;

json read_json(const std::string& path) { return read_json_without(path, {}); }

json read_json_without(const std::string& path, const std::vector<std::string>& members) {
  const std::string text = read_file(path, kLargestText);
  try {
    if (members.empty()) return json::parse(text);
    return json::parse(text, [&](int, json::parse_event_t event, json& value) {
      return event != json::parse_event_t::key ||
             std::find(members.begin(), members.end(), value.get_ref<const std::string&>()) == members.end();
    });
  } catch (const json::parse_error& error) {
    throw Error("is not JSON: broken at byte " + std::to_string(error.byte), path, "fetch the file again");
  } catch (const json::exception&) {
    throw Error("holds a number that is too large", path, "fetch the file again");
  }
}

double json_number(const json& object, const std::string& field, const std::string& path) {
  if (!object.is_object() || !object.contains(field)) throw Error("has no \"" + field + "\"", path);
  const json& value = object[field];
  if (!value.is_number() || !std::isfinite(value.get<double>()))
    throw Error("\"" + field + "\" is not a finite number", path);
  return value.get<double>();
}

}  // namespace citylearn
