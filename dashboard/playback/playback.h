// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <mutex>
#include <optional>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "core/recording/replayer.h"
#include "dashboard/playback/playback_control.h"

namespace citylearn {

/// The length of recordings and what is where in them: read in a thread of its own, as a long one takes a while.
class Timeline {
 public:
  explicit Timeline(std::vector<std::string> files) : files_(std::move(files)) {}
  /// Returns null before all files were read. May be used by any thread.
  std::shared_ptr<const RecordingOutline> outline() const;

 private:
  void read(const std::stop_token& stop);

  const std::vector<std::string> files_;
  mutable std::mutex mutex_;
  std::shared_ptr<const RecordingOutline> outline_;
  std::jthread thread_{[this](const std::stop_token& stop) { read(stop); }};
};

/// Plays recordings to the nodes of this process (middleware `inprocess`), in a thread of its own, while it lives.
class Playback : public PlaybackControl {
 public:
  /// `timeline` must outlive it. Throws Error when a file is not a recording.
  Playback(std::uint32_t domain, const ReplayOptions& options, std::uint64_t generation, const Timeline& timeline);

  ReplayState state() const override;
  std::uint64_t generation() const override { return generation_; }
  std::shared_ptr<const RecordingOutline> outline() const override { return timeline_.outline(); }
  /// A message cannot be taken back: an earlier position is reached by another playback, see restart().
  void change(const PlaybackChange& change) override;

  /// Returns the number of the last position that was asked for, once everything up to it has been played; nothing
  /// before, and while there is none but the beginning.
  std::optional<std::uint64_t> arrived() const;
  /// Says that what was played up to that position is shown. Until then state() says that it is on its way.
  void show(std::uint64_t arrival);
  /// Returns what is to be played by another playback, in place of this one; nothing while this one goes on.
  std::optional<ReplayOptions> restart() const;
  /// Returns ReplayClock::now(). May be used by any thread.
  Clock::time_point now() const { return replayer_.clock().now(); }
  /// Returns the messages for the user since the last call: the end, what is missing or damaged.
  std::vector<std::string> take_messages();

 private:
  void play(const std::stop_token& stop);
  void report(const std::string& line);

  const ReplayOptions options_;
  const std::uint64_t generation_;
  const Timeline& timeline_;
  std::unique_ptr<Middleware> middleware_;
  Replayer replayer_;
  mutable std::mutex mutex_;
  std::optional<ReplayOptions> restart_;
  std::uint64_t asked_;  // positions, of this playback
  std::uint64_t shown_ = 0;
  std::vector<std::string> messages_;
  std::jthread thread_{[this](const std::stop_token& stop) { play(stop); }};
};

/// A temporary folder that is removed with this object. The constructor throws Error when it cannot be created.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace citylearn
