// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <thread>

#include "dashboard/http/hub.h"

namespace citylearn {

/// Publishes the topic `runs`: while somebody watches it, reads the list periodically in a thread of its own, as it
/// comes out of the store, and sends it when it has changed.
class RunsFeed {
 public:
  RunsFeed(Hub& hub, std::function<nlohmann::json()> runs,
           std::chrono::milliseconds period = std::chrono::milliseconds(500));
  ~RunsFeed();
  RunsFeed(const RunsFeed&) = delete;
  RunsFeed& operator=(const RunsFeed&) = delete;

 private:
  void work();

  Hub& hub_;
  const std::function<nlohmann::json()> runs_;
  const std::chrono::milliseconds period_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace citylearn
