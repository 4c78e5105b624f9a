// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <compare>
#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "tests/support/files.h"
#include "tests/support/text.h"

namespace citylearn::testing {

/// A process of a service.
struct Source {
  std::string id;
  std::uint64_t incarnation = 0;
  auto operator<=>(const Source&) const = default;
};

/// Numbers of episodes, by the process of the env_service where they ended.
using Ledger = std::map<Source, std::set<std::uint64_t>>;

inline std::size_t entries(const Ledger& ledger) {
  std::size_t count = 0;
  for (const auto& [source, episodes] : ledger) count += episodes.size();
  return count;
}

/// The rows of a CSV file, without its header.
inline std::vector<std::vector<std::string>> csv_rows(const std::string& path) {
  std::vector<std::vector<std::string>> rows;
  for (const std::string& line : lines_of(contents(path))) rows.push_back(split(line, ','));
  if (!rows.empty()) rows.erase(rows.begin());
  return rows;
}

/// Returns the episodes of a policy_service's episodes.csv. Each must be there once.
inline Ledger in_csv(const std::string& path) {
  Ledger ledger;
  for (const auto& row : csv_rows(path)) {
    const Source source{row.at(0), std::stoull(row.at(1))};
    EXPECT_TRUE(ledger[source].insert(std::stoull(row.at(2))).second) << "twice: " << source.id << " " << row.at(2);
  }
  return ledger;
}

/// Each env_service's episodes have the numbers from 1 without a gap.
inline void expect_no_gaps(const Ledger& ledger) {
  for (const auto& [source, episodes] : ledger) {
    EXPECT_EQ(*episodes.begin(), 1u) << source.id;
    EXPECT_EQ(*episodes.rbegin(), episodes.size()) << "a gap in what " << source.id << " finished";
  }
}

}  // namespace citylearn::testing
