// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <string>

#include "dashboard/store/database.h"
#include "tests/support/records/episodes_csv.h"

namespace citylearn::testing {

/// Returns the episodes of a dashboard's store, in the session "default". Each must be there once.
inline Ledger in_store(const std::string& path) {
  Ledger ledger;
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source "
                         "WHERE s.session = 'default'");
  while (rows.executeStep()) {
    const Source source{value_at<std::string>(rows, 0), std::stoull(value_at<std::string>(rows, 1))};
    EXPECT_TRUE(ledger[source].insert(std::stoull(value_at<std::string>(rows, 2))).second)
        << "twice: " << source.id << value_at<std::string>(rows, 2);
  }
  return ledger;
}

/// Expects all acknowledged episodes in the ledger, without gaps.
inline void expect_all_acknowledged(const Ledger& ledger, const std::map<Source, std::uint64_t>& acknowledged) {
  expect_no_gaps(ledger);
  for (const auto& [source, episode] : acknowledged) {
    const auto found = ledger.find(source);
    const std::size_t has = found == ledger.end() ? 0 : found->second.size();
    EXPECT_GE(has, episode) << "acknowledged to " << source.id << " and lost";
  }
}

}  // namespace citylearn::testing
