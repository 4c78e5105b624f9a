// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

namespace citylearn {

/// Reads the file as JSON. Throws Error that says where it breaks off.
nlohmann::json read_json(const std::string& path);
/// Reads a list or an object whose members of these names are left out, which saves memory.
nlohmann::json read_json_without(const std::string& path, const std::vector<std::string>& members);
/// Returns a finite number of an object. Throws Error naming the field.
double json_number(const nlohmann::json& object, const std::string& field, const std::string& path);

}  // namespace citylearn
