// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <mutex>
#include <stop_token>
#include <thread>
#include <utility>

#include "core/util/machine.h"

namespace citylearn {

/// One thread that runs tasks in the order they were posted, so that a service goes on answering meanwhile. At its end
/// it finishes the task that runs and drops those not begun. In a simulation, tasks run as they are posted. Used by one
/// thread.
class BackgroundQueue {
 public:
  /// Runs `task` on the thread; run_completions() then calls `completion` on the caller's.
  void post(std::function<void()> task, std::function<void()> completion) {
    {
      std::unique_lock lock(mutex_);
      queued_.push_back({std::move(task), std::move(completion)});
      if (Machine::simulated()) return run_next(lock);
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

  void run_next(std::unique_lock<std::mutex>& lock) {
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

  void work(const std::stop_token& stop) {
    std::unique_lock lock(mutex_);
    while (condition_.wait(lock, stop, [this] { return !queued_.empty(); }) && !stop.stop_requested()) run_next(lock);
  }

  std::mutex mutex_;
  std::condition_variable_any condition_;
  std::deque<Task> queued_, done_;
  std::exception_ptr failure_;
  std::jthread thread_{[this](const std::stop_token& stop) { work(stop); }};
};

}  // namespace citylearn
