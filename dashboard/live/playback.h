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

/// Recordings that are played within this process, by a thread of their own, to a node of the middleware `inprocess`.
class Playback {
 public:
  /// Throws Error when a file is no recording.
  Playback(std::uint32_t domain, const ReplayOptions& options);
  /// Ends it where it is.
  ~Playback();
  Playback(const Playback&) = delete;
  Playback& operator=(const Playback&) = delete;

  /// What there is to be told since the last call, a line each: that it is over, what is missing or damaged.
  std::vector<std::string> news();

 private:
  void play();
  void tell(const std::string& line);

  std::unique_ptr<Middleware> middleware_;
  Replayer replayer_;
  std::atomic<bool> stop_{false};
  std::mutex mutex_;
  std::vector<std::string> news_;
  std::thread thread_;
};

/// A folder that goes with this object. Throws Error when there cannot be one.
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
