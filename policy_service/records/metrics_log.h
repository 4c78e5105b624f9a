// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/files/growing_file.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Writes one row an update into `metrics.csv`: the figures of core/task/training_figures.inc.
class MetricsLog {
 public:
  /// Starts the file anew or, when `after_update` > 0, keeps its rows up to that update (rows past the last checkpoint
  /// will be computed again). Throws Error naming the file when it cannot be written.
  MetricsLog(const std::string& path, std::uint64_t after_update);

  /// Writes a row. While the disk is full rows wait, and problem() says so until flush() succeeds.
  void write(const msg::TrainingStat& stat);
  void flush() { file_->flush(); }
  void sync() { file_->sync(); }
  const std::string& problem() const { return file_->problem(); }
  /// Returns the seconds of training in the last row kept; 0 for a new file.
  double wall() const { return wall_; }
  /// Returns the seconds of training in the first row kept with at least so many episodes; 0 when there is none.
  double wall_at(std::uint64_t episodes) const;

 private:
  std::optional<GrowingFile> file_;
  double wall_ = 0;
  std::vector<std::pair<std::uint64_t, double>> kept_;  ///< episodes and wall of each row kept
};

}  // namespace citylearn
