// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "tests/support/processes/trial.h"
#include "tests/support/records/episodes_csv.h"

namespace citylearn::testing {

inline constexpr seconds kWholeRun{240};

/// A learner's run: what is in its folder tells how far it is.
class Learning {
 public:
  explicit Learning(const std::string& middleware) : trial(middleware) {}
  /// Joins the domain of `other` over another vendor.
  Learning(const std::string& middleware, const Learning& other) : trial(middleware, other.trial.domain()) {}

  std::unique_ptr<Service> learner(int updates, Arguments more = {}) {
    more.insert(more.end(), {"--role", "learner", "--steps", std::to_string(updates * 512), "--trainer-agents", "8",
                             "--checkpoint-every", "10", "--output", trial.folder() / "out", "--tasks", "100",
                             "--evaluate", "summer"});
    return trial.policy(more);
  }
  std::unique_ptr<Service> actor(const std::string& id, Arguments more = {}) {
    more.insert(more.end(), {"--role", "actor", "--id", id});
    return trial.policy(more);
  }
  std::vector<std::vector<std::string>> metrics() const { return csv_rows(trial.folder() / "out/metrics.csv"); }
  /// Number of the last update on record; 0 before the first.
  int updates() const {
    const auto rows = metrics();
    return rows.empty() ? 0 : std::stoi(rows.back().at(0));
  }
  bool reaches(int wanted) const {
    return poll_until([&] { return updates() >= wanted; }, kWholeRun);
  }
  /// Every episode is on record once, numbered without gaps in each env_service, and so is every update.
  void expect_whole_records() const {
    const Ledger episodes = in_csv(trial.folder() / "out/episodes.csv");
    EXPECT_FALSE(episodes.empty());
    expect_no_gaps(episodes);
    int update = 0;
    for (const auto& row : metrics()) {
      EXPECT_EQ(std::stoi(row.at(0)), ++update);
      EXPECT_EQ(row.at(1), std::to_string(512 * update)) << "each step is learned from once";
    }
  }

  Trial trial;
};

}  // namespace citylearn::testing
