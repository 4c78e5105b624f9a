// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <mutex>
#include <thread>

#include "core/wire/node.h"

namespace citylearn {

/// Beats for a node while its thread computes for long, so that whoever watches does not take it for lost. Used by the
/// node's thread.
class Heart {
 public:
  explicit Heart(Node& node) : node_(node), thread_([this] { beat(); }) {}
  ~Heart() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }
  Heart(const Heart&) = delete;
  Heart& operator=(const Heart&) = delete;

  /// `work()`, which must leave the node alone.
  template <class Work>
  auto beside(Work work) {
    const Lent lent(*this);
    return work();
  }

 private:
  /// The node, lent to the thread.
  class Lent {
   public:
    explicit Lent(Heart& heart) : heart_(heart) {
      {
        const std::lock_guard lock(heart_.mutex_);
        heart_.lent_ = true;
      }
      heart_.wake_.notify_one();
    }
    ~Lent() {
      const std::lock_guard lock(heart_.mutex_);  // not in the middle of a beat
      heart_.lent_ = false;
    }

   private:
    Heart& heart_;
  };

  void beat() {
    std::unique_lock lock(mutex_);
    while (!stop_) {
      if (lent_) {
        node_.publish_heartbeat_if_due();
        wake_.wait_until(lock, node_.next_heartbeat());
      } else {
        wake_.wait(lock);
      }
    }
  }

  Node& node_;
  std::mutex mutex_;
  std::condition_variable wake_;
  bool lent_ = false, stop_ = false;
  std::thread thread_;
};

}  // namespace citylearn
