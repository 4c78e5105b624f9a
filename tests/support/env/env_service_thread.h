// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <thread>
#include <utility>

#include "env_service/env_service.h"

namespace citylearn::testing {

/// An env_service that runs in a thread of the test until this object goes.
class EnvServiceThread {
 public:
  EnvServiceThread(const EnvServiceOptions& options, Traversal traversal)
      : traversal_(std::move(traversal)),
        thread_([this, options] { run_env_service(options, traversal_, [this] { return stop_.load(); }); }) {}
  ~EnvServiceThread() {
    stop_ = true;
    thread_.join();
  }
  EnvServiceThread(const EnvServiceThread&) = delete;
  EnvServiceThread& operator=(const EnvServiceThread&) = delete;

 private:
  const Traversal traversal_;
  std::atomic<bool> stop_ = false;
  std::thread thread_;  // begins once the others are there
};

}  // namespace citylearn::testing
