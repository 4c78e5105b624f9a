// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

namespace citylearn {

/// A value of one metric, in one record of a run's log.
struct LoggedPoint {
  std::uint32_t metric = 0;  ///< index into LogBatch::metrics()
  std::uint64_t record = 0;  ///< number of the record
  double step = 0;           ///< as the program counts them
  double time = 0;           ///< seconds since 1970
  double value = 0;          ///< NaN: no number
};

/// What a program says of itself when it begins, or goes on, to log a run.
struct LogBeginning {
  double started = 0;  ///< seconds since 1970
  std::string title;   ///< for people; may be empty
  std::vector<std::string> tags;
  std::string note;
};

/// Successive records of the log of one run (docs/reference/dashboard-api.md, "Logged runs"). Records are numbered from
/// 1 on, in the order in which the program logged them.
class LogBatch {
 public:
  /// The batch begins with record `first`.
  explicit LogBatch(std::uint64_t first) : first_(first), next_(first) {}

  std::string source;  ///< what logs: "python", "tensorboard", "wandb"
  std::string log;     ///< identifies the log: of two logs of one run the second is refused
  /// Whether the run has ended, if that is known. No record: what is imported may grow and be imported again.
  std::optional<bool> ended;

  // Each record is one of these.
  void begin(LogBeginning beginning) {
    beginning_ = std::move(beginning);
    ended = false;
    ++next_;
  }
  /// Adds a point of the current record. points_done() ends the record.
  void add(std::string_view metric, double step, double time, double value) {
    add(index_of(metric), step, time, value);
  }
  void add(std::uint32_t metric, double step, double time, double value) {
    points_.push_back({metric, next_, step, time, value});
  }
  void points_done() { ++next_; }
  /// `members` is a JSON object: options to add to those of the run, or to replace.
  void configure(std::string members) {
    config_.push_back(std::move(members));
    ++next_;
  }
  /// Likewise for final figures.
  void summarise(std::string members) {
    summary_.push_back(std::move(members));
    ++next_;
  }
  void end() {
    ended = true;
    ++next_;
  }

  /// Returns the index of a metric in metrics(), where it is put if it is new.
  std::uint32_t index_of(std::string_view metric);
  void reserve(std::size_t points) { points_.reserve(points); }

  std::uint64_t first() const { return first_; }
  std::uint64_t end_record() const { return next_; }  ///< number behind the last record
  const std::vector<std::string>& metrics() const { return metrics_; }
  const std::vector<LoggedPoint>& points() const { return points_; }
  const std::optional<LogBeginning>& beginning() const { return beginning_; }
  const std::vector<std::string>& config() const { return config_; }
  const std::vector<std::string>& summary() const { return summary_; }

 private:
  std::uint64_t first_, next_;
  std::vector<std::string> metrics_;
  std::unordered_map<std::string, std::uint32_t> indices_;  // of metrics
  std::vector<LoggedPoint> points_;
  std::optional<LogBeginning> beginning_;
  std::vector<std::string> config_, summary_;
};

}  // namespace citylearn
