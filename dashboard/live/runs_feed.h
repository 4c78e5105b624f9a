// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <nlohmann/json.hpp>
#include <stop_token>
#include <thread>

#include "dashboard/http/hub.h"

namespace citylearn {

/// Publishes the topic `runs`: while it is watched, reads the list periodically in a thread of its own, as it
/// comes out of the store, and sends it when it has changed.
class RunsFeed {
 public:
  RunsFeed(Hub& hub, std::function<nlohmann::json()> runs,
           std::chrono::milliseconds period = std::chrono::milliseconds(500));

 private:
  void work(const std::stop_token& stop);

  Hub& hub_;
  const std::function<nlohmann::json()> runs_;
  const std::chrono::milliseconds period_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  std::jthread thread_{[this](const std::stop_token& stop) { work(stop); }};
};

}  // namespace citylearn
