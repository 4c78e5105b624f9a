// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/util/growing_file.h"
#include "core/wire/messages.h"

namespace citylearn {

/// One row an update in `metrics.csv`: the figures of TrainingStat under its field names.
class MetricsLog {
 public:
  /// Starts the file anew, or, when `after_update` > 0, keeps its rows up to that update (what a killed process wrote
  /// past its last checkpoint is computed again). Throws Error naming the file when it cannot be written.
  MetricsLog(const std::string& path, std::uint64_t after_update);

  /// A row that cannot be written (disk full) waits; problem() then says so until flush() went well.
  void write(const msg::TrainingStat& stat);
  void flush() { file_->flush(); }
  const std::string& problem() const { return file_->problem(); }
  /// Seconds of training in the last row kept; 0 for a new file.
  double wall() const { return wall_; }
  /// Seconds of training in the first row kept that has at least so many episodes; 0 when there is none.
  double wall_at(std::uint64_t episodes) const;

 private:
  std::optional<GrowingFile> file_;
  double wall_ = 0;
  std::vector<std::pair<std::uint64_t, double>> kept_;  ///< episodes and wall of each row kept
};

}  // namespace citylearn
