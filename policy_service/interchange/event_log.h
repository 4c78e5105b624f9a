// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/files/growing_file.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Writes one point an update and figure into a TensorBoard event file, under the tags of
/// core/task/training_figures.inc, which ML-Agents uses too. A point's step counts environment steps. Undefined figures
/// (NaN) are omitted.
///
/// The file is TFRecords (core/files/tf_records.h), the payload an Event of tensorflow/core/util/event.proto.
class EventLog {
 public:
  /// Begins a new file in `folder` (making it). With `after_steps` > 0 a run continues: older event files lose the
  /// points past it, which a killed process wrote and which will be computed again. With 0 older event files are
  /// removed. Throws Error naming the file that cannot be written.
  EventLog(const std::string& folder, std::uint64_t after_steps);

  /// Counts a finished training episode, for the mean length of those since the last write.
  void finished(const msg::EpisodeStat& episode);
  /// Writes a point. While the disk is full points wait, and problem() says so until flush() succeeds.
  void write(const msg::TrainingStat& stat);
  void flush() { file_->flush(); }
  void sync() { file_->sync(); }
  const std::string& problem() const { return file_->problem(); }
  const std::string& path() const { return path_; }

 private:
  void record(const std::string& event);

  std::string path_;
  std::optional<GrowingFile> file_;
  std::uint64_t episodes_ = 0, episode_steps_ = 0;
};

}  // namespace citylearn
