// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "core/recording/replayer.h"

namespace citylearn {

/// Plays recordings to the nodes of this process (middleware `inprocess`), in a thread of its own, while it lives.
class Playback {
 public:
  /// Throws Error when a file is not a recording.
  Playback(std::uint32_t domain, const ReplayOptions& options);

  /// Returns ReplayClock::now(). May be used by any thread.
  Clock::time_point now() const { return replayer_.clock().now(); }
  /// Returns the messages for the user since the last call: the end, what is missing or damaged.
  std::vector<std::string> take_messages();

 private:
  void play(const std::stop_token& stop);
  void report(const std::string& line);

  std::unique_ptr<Middleware> middleware_;
  Replayer replayer_;
  std::mutex mutex_;
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
