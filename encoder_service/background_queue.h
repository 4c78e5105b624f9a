// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <thread>
#include <utility>

namespace citylearn {

/// One thread that runs tasks in the order they were posted, so that a service goes on answering meanwhile. Used by one
/// thread.
class BackgroundQueue {
 public:
  BackgroundQueue() : thread_([this] { work(); }) {}
  /// Finishes the task that runs; those not begun are dropped.
  ~BackgroundQueue() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    condition_.notify_one();
    thread_.join();
  }
  BackgroundQueue(const BackgroundQueue&) = delete;
  BackgroundQueue& operator=(const BackgroundQueue&) = delete;

  /// Runs `task` on the thread; run_completions() then calls `completion` on the caller's.
  void post(std::function<void()> task, std::function<void()> completion) {
    {
      const std::lock_guard lock(mutex_);
      queued_.push_back({std::move(task), std::move(completion)});
    }
    condition_.notify_one();
  }

  /// Calls the completion of each task done since the last call. Throws what a task threw.
  void run_completions() {
    std::deque<Task> done;
    std::exception_ptr failure;
    {
      const std::lock_guard lock(mutex_);
      done.swap(done_);
      failure = std::exchange(failure_, nullptr);
    }
    for (Task& task : done) task.completion();
    if (failure) std::rethrow_exception(failure);
  }

 private:
  struct Task {
    std::function<void()> run, completion;
  };

  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      condition_.wait(lock, [this] { return stopping_ || !queued_.empty(); });
      if (stopping_) return;
      Task task = std::move(queued_.front());
      queued_.pop_front();
      lock.unlock();
      std::exception_ptr failure;
      try {
        task.run();
      } catch (...) {
        failure = std::current_exception();
      }
      lock.lock();
      if (failure)
        failure_ = failure;
      else
        done_.push_back(std::move(task));
    }
  }

  std::mutex mutex_;
  std::condition_variable condition_;
  std::deque<Task> queued_, done_;
  std::exception_ptr failure_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace citylearn
