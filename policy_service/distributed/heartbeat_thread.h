// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <stop_token>
#include <thread>

#include "core/util/machine.h"
#include "core/wire/node.h"

namespace citylearn {

/// Publishes a node's heartbeat while the node's thread computes for long, so that watchers do not take it for lost.
/// Used by the node's thread.
class HeartbeatThread {
 public:
  explicit HeartbeatThread(Node& node) : node_(node) {}

  /// Returns work(), which must not use the node.
  template <class Work>
  auto run(Work work) {
    if (Machine::simulated()) return work();  // which takes no time there
    const NodeLease lease(*this);
    return work();
  }

 private:
  /// Lends the node to the heartbeat thread.
  class NodeLease {
   public:
    explicit NodeLease(HeartbeatThread& heart) : heartbeat_(heart) {
      {
        const std::lock_guard lock(heartbeat_.mutex_);
        heartbeat_.lent_ = true;
      }
      heartbeat_.wake_.notify_one();
    }
    ~NodeLease() {
      const std::lock_guard lock(heartbeat_.mutex_);  // waits for a heartbeat in progress
      heartbeat_.lent_ = false;
    }

   private:
    HeartbeatThread& heartbeat_;
  };

  void loop(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (wake_.wait(lock, stop, [this] { return lent_; }) && !stop.stop_requested()) {
      const Clock::time_point next = node_.publish_heartbeat_if_due();
      wake_.wait_until(lock, stop, next, [this] { return !lent_; });
    }
  }

  Node& node_;
  std::mutex mutex_;
  std::condition_variable_any wake_;
  bool lent_ = false;
  std::jthread thread_{[this](const std::stop_token& stop) { loop(stop); }};
};

}  // namespace citylearn
