// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "core/recording/replayer.h"

namespace citylearn {

/// Plays recordings to the nodes of this process (middleware `inprocess`), in a thread of its own.
class Playback {
 public:
  /// Throws Error when a file is not a recording.
  Playback(std::uint32_t domain, const ReplayOptions& options);
  /// Stops playing.
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  /// Returns the messages for the user since the last call: the end, what is missing or damaged.
  std::vector<std::string> take_messages();

 private:
  void play();
  void report(const std::string& line);

  std::unique_ptr<Middleware> middleware_;
  Replayer replayer_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::vector<std::string> messages_;
  std::thread thread_;
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
