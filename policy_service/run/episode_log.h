// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "core/util/growing_file.h"
#include "core/wire/messages.h"

namespace citylearn {

/// Every finished episode once, in `episodes.csv`. An episode counts as recorded when its row has left this process, so
/// that whoever is told so may forget it.
class EpisodeLog {
 public:
  /// Goes on with the file when it exists: what it holds is known as recorded, a row cut short by a crash is dropped.
  /// An empty path records in memory alone. Throws Error naming the file when it is not an episode log or cannot be
  /// written.
  explicit EpisodeLog(const std::string& path);

  /// True when this episode was new. Order and repetition don't matter. While the disk takes nothing, rows wait, and
  /// beyond kMostWaiting bytes of them episodes are not taken: their env_service sends them again.
  bool record(const msg::EpisodeStat& episode);
  /// Counts as recorded without a row: it is not of this log.
  void pass_over(const msg::EpisodeStat& episode);
  /// Hands the rows to the operating system and returns the number up to which all of this env_service's episodes are
  /// recorded. When that fails (disk full), problem() says so and the number is that of the last time it went well.
  std::uint64_t recorded(const std::string& environment, std::uint64_t incarnation);
  std::string problem() const { return file_ ? file_->problem() : ""; }
  std::uint64_t total() const { return total_; }

 private:
  struct Progress {
    std::uint64_t contiguous = 0;          ///< all episodes up to this one are recorded, or wait for the disk
    std::uint64_t handed_on = 0;           ///< up to this one none waits
    std::map<std::uint64_t, bool> beyond;  ///< recorded ones after a gap
    void add(std::uint64_t episode);
    void skip_to(std::uint64_t episode);
  };
  static constexpr std::size_t kMostWaiting = 16 << 20;
  void load();
  Progress& progress_of(const msg::EpisodeStat& episode);

  std::string path_;
  std::optional<GrowingFile> file_;
  std::map<std::pair<std::string, std::uint64_t>, Progress> progress_;
  std::uint64_t total_ = 0;
};

}  // namespace citylearn
