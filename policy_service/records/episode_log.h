// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "core/files/growing_file.h"
#include "core/util/number_set.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Writes every finished episode once into `episodes.csv`, those of an env_service in their order: if it dies, none is
/// missing between those that are there. An episode counts as recorded when its row is on the disk, so that an
/// env_service that is told so may forget it.
class EpisodeLog {
 public:
  /// Continues the file when it exists: its rows count as recorded. A row that was cut short by a crash or damaged by a
  /// loss of power is dropped, with those that follow it. An empty path records in memory alone. Throws Error naming
  /// the file when it is not an episode log or cannot be written.
  explicit EpisodeLog(const std::string& path);

  /// Returns whether the file has more than its header.
  static bool has_rows(const std::string& path);

  /// Returns whether this episode was new. They may come in any order: rows wait in memory for earlier ones. Rows also
  /// wait while the disk accepts nothing. When too much waits episodes are refused, and their env_service sends them
  /// again.
  bool record(const msg::EpisodeStat& episode);
  /// Counts an episode of another run as recorded, without a row.
  void skip(const msg::EpisodeStat& episode);
  /// Waits until the rows are on the disk and returns the number up to which all of this env_service's episodes are
  /// recorded. When that fails (disk full), problem() says why and the number stays as it was.
  std::uint64_t recorded(const std::string& environment, std::uint64_t incarnation);
  /// Returns whether later episodes of this env_service have come than one that is missing.
  bool has_gap(const std::string& environment, std::uint64_t incarnation) const;
  std::string problem() const { return file_ ? file_->problem() : ""; }
  std::uint64_t total() const { return total_; }

 private:
  struct Received {
    std::map<std::uint64_t, std::string> early;  ///< rows that wait for earlier ones
    RecordedNumbers episodes;                    ///< recorded, or waiting for the disk
    std::uint64_t on_disk = 0;                   ///< up to this one none waits
  };
  static constexpr std::size_t kMaxWaitingBytes = 16 << 20;  ///< bytes for the disk
  static constexpr std::size_t kMaxEarlyRows = 4096;         ///< rows of an env_service
  void load();
  void write_in_order(Received& received);
  Received& received_from(const msg::EpisodeStat& episode);

  std::string path_;
  std::optional<GrowingFile> file_;
  std::map<std::pair<std::string, std::uint64_t>, Received> received_;
  std::uint64_t total_ = 0;
};

}  // namespace citylearn
