// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <exception>
#include <functional>
#include <mutex>
#include <vector>

#include "core/util/types.h"

namespace citylearn::internal {

/// Wakes the one thread that waits in Middleware::wait when a vendor's thread has something.
///
/// Each subscription owns a Flag. A vendor's thread raises it when a sample comes; the subscription lowers it before it
/// looks and finds nothing, so a sample that comes in between is not missed.
class Wakeup {
 public:
  class Flag {
   public:
    explicit Flag(Wakeup& wakeup) : wakeup_(wakeup) { wakeup_.flags_.push_back(this); }
    ~Flag() { std::erase(wakeup_.flags_, this); }
    Flag(const Flag&) = delete;
    Flag& operator=(const Flag&) = delete;
    void raise() {  // by any thread
      raised_.store(true);
      wakeup_.wake();
    }
    void raise_quietly() { raised_.store(true); }  // by the waiting thread itself
    void lower() { raised_.store(false); }
    bool raised() const { return raised_.load(); }

   private:
    Wakeup& wakeup_;
    std::atomic<bool> raised_{false};
  };

  /// Waits until a flag is raised (true) or the deadline has passed (false). Spins for a short while before it sleeps
  /// if that would have been enough the last time: waking up takes longer than an answer from the same machine.
  bool wait(Clock::time_point deadline);
  /// See Middleware::answer_at_once(). Used by the waiting thread.
  void set_handler(const std::function<bool()>& handler) { handler_ = handler; }

 private:
  void wake();
  bool any_raised() const;
  bool look(Clock::time_point deadline) const;

  bool look_first_ = true;
  std::vector<Flag*> flags_;  // changed and read by the waiting thread alone
  // A thread that holds the mutex while this is true releases it soon, and waits for nothing before.
  std::atomic<bool> asleep_{false};
  std::function<bool()> handler_;  // this, and what follows, belongs to the holder of the mutex while asleep_
  bool called_ = false;            // the handler wants the waiting thread
  std::exception_ptr failure_;     // of the handler
  std::mutex mutex_;
  std::condition_variable condition_;
};

}  // namespace citylearn::internal
