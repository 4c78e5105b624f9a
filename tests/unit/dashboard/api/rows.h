// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "core/files/files.h"
#include "tests/paths.h"

namespace citylearn::testing {

inline std::vector<std::string> keys(const nlohmann::json& json) {
  std::vector<std::string> names;
  for (const auto& [name, value] : json.items()) names.push_back(name);
  return names;
}

/// Expects the members of such a row as dashboard/api/rows.json shows by example, no other ones, and their types.
inline void expect_row(const nlohmann::json& row, const std::string& kind) {
  static const auto rows = nlohmann::json::parse(read_file(CITYLEARN_SOURCE_DIR "/dashboard/api/rows.json"));
  EXPECT_EQ(keys(row), keys(rows.at(kind))) << kind;
  for (const auto& [name, example] : rows.at(kind).items()) {
    const bool nullable = example.is_array() && std::find(example.begin(), example.end(), nullptr) != example.end();
    const nlohmann::json value = row.value(name, nlohmann::json());
    if (nullable && value.is_null()) continue;
    EXPECT_STREQ(value.type_name(), (nullable ? example[0] : example).type_name()) << kind << ": " << name;
  }
}

}  // namespace citylearn::testing
