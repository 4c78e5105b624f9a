// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <cstdint>
#include <fstream>
#include <map>
#include <set>
#include <sstream>
#include <string>

#include "dashboard/store/database.h"
#include "tests/support/witness.h"

namespace citylearn::testing {

/// Numbers of episodes, by the process of the env_service where they ended.
using Ledger = std::map<Source, std::set<std::uint64_t>>;

inline std::size_t entries(const Ledger& ledger) {
  std::size_t count = 0;
  for (const auto& [source, episodes] : ledger) count += episodes.size();
  return count;
}

/// Of a policy_service's episodes.csv. Each must be there once.
inline Ledger in_csv(const std::string& path) {
  Ledger ledger;
  std::ifstream in(path);
  std::string line, id, incarnation, episode;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::istringstream fields(line);
    std::getline(fields, id, ',');
    std::getline(fields, incarnation, ',');
    std::getline(fields, episode, ',');
    const Source source{id, std::stoull(incarnation)};
    EXPECT_TRUE(ledger[source].insert(std::stoull(episode)).second) << "twice: " << line;
  }
  return ledger;
}

/// Of a dashboard's store. Each must be there once.
inline Ledger in_store(const std::string& path) {
  Ledger ledger;
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source");
  while (rows.executeStep()) {
    const Source source{value_at<std::string>(rows, 0), std::stoull(value_at<std::string>(rows, 1))};
    EXPECT_TRUE(ledger[source].insert(std::stoull(value_at<std::string>(rows, 2))).second)
        << "twice: " << source.id << value_at<std::string>(rows, 2);
  }
  return ledger;
}

/// All that was acknowledged stands in the ledger, which has no gaps.
inline void expect_all_acknowledged(const Ledger& ledger, const std::map<Source, std::uint64_t>& acknowledged) {
  for (const auto& [source, episodes] : ledger) {
    EXPECT_EQ(*episodes.begin(), 1u) << source.id;
    EXPECT_EQ(*episodes.rbegin(), episodes.size()) << "a gap in what " << source.id << " finished";
  }
  for (const auto& [source, episode] : acknowledged) {
    const auto found = ledger.find(source);
    const std::size_t has = found == ledger.end() ? 0 : found->second.size();
    EXPECT_GE(has, episode) << "acknowledged to " << source.id << " and lost";
  }
}

}  // namespace citylearn::testing
