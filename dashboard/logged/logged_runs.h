// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "dashboard/logged/log_batch.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Bounds of a logged run.
inline constexpr std::size_t kMostMetrics = 10'000, kLongestMetric = 256;
inline constexpr std::uint64_t kMostRecords = std::uint64_t{1} << 39;
inline constexpr std::size_t kLongestSource = 64;       ///< bytes; also of what identifies the log
inline constexpr std::size_t kLongestConfig = 1 << 20;  ///< bytes of JSON, also of the summary

/// Returns what is wrong with the ID of a logged run, which is PROJECT/NAME, both escaped as in run_id(); nothing when
/// it is right.
std::optional<std::string> fault_of_logged_id(const std::string& id);

/// Returns whether a text has control characters (those of ASCII) but `allowed` ones.
bool has_control(std::string_view text, std::string_view allowed = "");

/// Returns what is wrong with the name of a metric, which is UTF-8; nothing when it is right.
std::optional<std::string> fault_of_metric(const std::string& name);

/// Records in the store what programs log of their runs. May be used by several threads.
class LoggedRuns {
 public:
  /// `store` must outlive it.
  explicit LoggedRuns(Store& store) : store_(store) {}

  struct Outcome {
    std::uint64_t received = 0;  ///< records of the log that are committed, from the first one on
    bool other_log = false;      ///< the run belongs to another log: nothing was taken
  };
  /// Commits the records that are new, each once however often it comes. Takes nothing of a batch that begins behind a
  /// gap: the sender goes on with record `received` + 1. Makes the run if there is none of this ID. Throws Error when
  /// the store cannot be written, or for a run with too many metrics or options; nothing is then kept.
  Outcome append(const std::string& id, const LogBatch& batch);

 private:
  Store& store_;
};

}  // namespace citylearn
