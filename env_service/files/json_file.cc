// SPDX-License-Identifier: Apache-2.0
#include "env_service/files/json_file.h"

#include <cmath>
#include <nlohmann/json.hpp>

#include "core/files/files.h"
#include "core/files/json.h"
#include "core/util/error.h"
#include "env_service/files/files.h"

namespace citylearn {

using nlohmann::json;

json read_json(const std::string& path) { return read_json_without(path, {}); }

json read_json_without(const std::string& path, const std::vector<std::string>& members) {
  return parse_json(read_file(path, kMaxTextBytes), path, "fetch the file again", members);
}

double json_number(const json& object, const std::string& field, const std::string& path) {
  if (!object.is_object() || !object.contains(field)) throw Error("has no \"" + field + "\"", path);
  const json& value = object[field];
  if (!value.is_number() || !std::isfinite(value.get<double>()))
    throw Error("\"" + field + "\" is not a finite number", path);
  return value.get<double>();
}

}  // namespace citylearn
