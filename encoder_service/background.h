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

/// One thread that does tasks in the order they were given, so that a service goes on answering meanwhile. What a task
/// leaves behind is seen by finished(), on the thread that asks. Used by one thread.
class Background {
 public:
  Background() : thread_([this] { work(); }) {}
  /// Finishes the task at hand; those not begun are dropped.
  ~Background() {
    {
      const std::lock_guard lock(mutex_);
      stopping_ = true;
    }
    condition_.notify_one();
    thread_.join();
  }
  Background(const Background&) = delete;
  Background& operator=(const Background&) = delete;

  /// `task` runs behind; then `finish` is called by finished().
  void post(std::function<void()> task, std::function<void()> finish) {
    {
      const std::lock_guard lock(mutex_);
      todo_.push_back({std::move(task), std::move(finish)});
    }
    condition_.notify_one();
  }

  /// Calls what follows each task done since the last call; true when there was one. Throws what a task threw.
  bool finished() {
    std::deque<Task> done;
    std::exception_ptr failure;
    {
      const std::lock_guard lock(mutex_);
      done.swap(done_);
      failure = std::exchange(failure_, nullptr);
    }
    for (Task& task : done) task.finish();
    if (failure) std::rethrow_exception(failure);
    return !done.empty();
  }

 private:
  struct Task {
    std::function<void()> run, finish;
  };

  void work() {
    std::unique_lock lock(mutex_);
    while (true) {
      condition_.wait(lock, [this] { return stopping_ || !todo_.empty(); });
      if (stopping_) return;
      Task task = std::move(todo_.front());
      todo_.pop_front();
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
  std::deque<Task> todo_, done_;
  std::exception_ptr failure_;
  bool stopping_ = false;
  std::thread thread_;
};

}  // namespace citylearn
