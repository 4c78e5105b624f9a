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
class Beside {
 public:
  virtual ~Beside() = default;
};

/// Runs until `stop` is true.
using BesideBody = std::function<void(const std::function<bool()>& stop)>;

/// A thread.
class BesideThread : public Beside {
 public:
  explicit BesideThread(const BesideBody& body) : thread_([this, body] { body([this] { return stop_.load(); }); }) {}
  ~BesideThread() override {
    stop_ = true;
    thread_.join();
  }
  BesideThread(const BesideThread&) = delete;
  BesideThread& operator=(const BesideThread&) = delete;

 private:
  std::atomic<bool> stop_ = false;
  std::thread thread_;  // begins once the others are there
};

inline std::unique_ptr<Beside> start_thread(const BesideBody& body) { return std::make_unique<BesideThread>(body); }

/// How tests start what runs beside them. Those in simulation start a process there (tests/simulation/programs.h).
inline std::unique_ptr<Beside> (*start_beside)(const BesideBody& body) = start_thread;

/// An env_service that runs beside the test until this object goes.
class EnvServiceThread {
 public:
  EnvServiceThread(const EnvServiceOptions& options, Traversal traversal)
      : traversal_(std::move(traversal)), running_(start_beside([this, options](const std::function<bool()>& stop) {
          run_env_service(options, traversal_, stop);
        })) {}

 private:
  const Traversal traversal_;
  const std::unique_ptr<Beside> running_;
};

}  // namespace citylearn::testing
