// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <thread>
#include <utility>

#include "env_service/env_service.h"

namespace citylearn::testing {

/// Something that runs beside the test. It is told to stop, and waited for, when this object goes.
class BackgroundTask {
 public:
  virtual ~BackgroundTask() = default;
};

/// Runs until `stop` is true.
using TaskBody = std::function<void(const std::function<bool()>& stop)>;

/// A thread.
class BackgroundThread : public BackgroundTask {
 public:
  explicit BackgroundThread(const TaskBody& body) : thread_([this, body] { body([this] { return stop_.load(); }); }) {}
  ~BackgroundThread() override {
    stop_ = true;
    thread_.join();
  }
  BackgroundThread(const BackgroundThread&) = delete;
  BackgroundThread& operator=(const BackgroundThread&) = delete;

 private:
  std::atomic<bool> stop_ = false;
  std::thread thread_;  // begins once the others are there
};

inline std::unique_ptr<BackgroundTask> start_background_thread(const TaskBody& body) {
  return std::make_unique<BackgroundThread>(body);
}

/// The function by which tests start what runs beside them. Those in simulation start a process there
/// (tests/simulation/services/programs.cc).
inline std::unique_ptr<BackgroundTask> (*start_background)(const TaskBody& body) = start_background_thread;

/// An env_service that runs beside the test until this object goes.
class EnvServiceThread {
 public:
  EnvServiceThread(const EnvServiceOptions& options, Traversal traversal)
      : traversal_(std::move(traversal)), running_(start_background([this, options](const std::function<bool()>& stop) {
          run_env_service(options, traversal_, stop);
        })) {}

 private:
  const Traversal traversal_;
  const std::unique_ptr<BackgroundTask> running_;
};

}  // namespace citylearn::testing
