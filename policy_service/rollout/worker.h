// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace citylearn {

/// Does two halves of some work at once, on the caller's thread and on its own. Used by one thread.
class Worker {
 public:
  Worker() : thread_([this] { loop(); }) {}
  ~Worker() {
    {
      const std::lock_guard lock(mutex_);
      stop_ = true;
    }
    wake_.notify_one();
    thread_.join();
  }
  Worker(const Worker&) = delete;
  Worker& operator=(const Worker&) = delete;

  /// Runs half(0) here and half(1) on the thread; returns when both are done. `half` must not throw.
  void both(const std::function<void(int)>& half) {
    {
      const std::lock_guard lock(mutex_);
      work_ = &half;
    }
    wake_.notify_one();
    half(0);
    std::unique_lock lock(mutex_);
    done_.wait(lock, [this] { return work_ == nullptr; });
  }

 private:
  void loop() {
    std::unique_lock lock(mutex_);
    while (true) {
      wake_.wait(lock, [this] { return stop_ || work_ != nullptr; });
      if (stop_) return;
      const std::function<void(int)>* work = work_;
      lock.unlock();
      (*work)(1);
      lock.lock();
      work_ = nullptr;
      done_.notify_one();
    }
  }

  std::mutex mutex_;
  std::condition_variable wake_, done_;
  const std::function<void(int)>* work_ = nullptr;
  bool stop_ = false;
  std::thread thread_;
};

}  // namespace citylearn
