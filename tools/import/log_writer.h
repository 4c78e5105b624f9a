// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <future>
#include <string>
#include <string_view>

#include "dashboard/logged/logged_runs.h"

namespace citylearn {

/// Takes records of a run's log, as LoggedRuns::append() does. The batches of a LogWriter hold either points alone or
/// one other record.
using LogSink = std::function<LoggedRuns::Outcome(const std::string& id, const LogBatch& batch)>;

/// Points that are written at once: as many as are sorted and committed quickly.
inline constexpr std::size_t kPointsOfBatch = 500'000;

/// Writes the log of a run that is imported, from its first record on, into a sink. What the sink has already is
/// skipped there: an import may be repeated. The sink takes a batch on another thread while the next one is filled, one
/// after the other.
class LogWriter {
 public:
  struct Options {
    std::string id;          ///< of the run: PROJECT/NAME
    std::string source;      ///< "tensorboard", "wandb"
    std::string log;         ///< identifies the log
    std::size_t points = 0;  ///< of one batch
  };
  LogWriter(LogSink sink, Options options);

  void begin(LogBeginning beginning);
  void configure(std::string members);
  void summarise(std::string members);
  void add(std::string_view metric, double step, double time, double value) { batch_.add(metric, step, time, value); }
  /// Ends a record of points.
  void points_done();
  /// Writes what is left. Throws Error, as all methods do, when the sink does not take it, or what came before.
  void finish(bool ended);

  std::uint64_t points() const { return points_; }  ///< that the sink has taken

 private:
  void flush();
  void settle();
  LogBatch next_batch() const;

  const LogSink sink_;
  const Options options_;
  LogBatch batch_{1};
  std::uint64_t points_ = 0, under_way_ = 0;
  std::future<LoggedRuns::Outcome> taken_;  // of the batch before; its destructor waits
};

/// Returns PROJECT/NAME, escaped as run_id() does.
std::string logged_id(const std::string& project, const std::string& name);

}  // namespace citylearn
