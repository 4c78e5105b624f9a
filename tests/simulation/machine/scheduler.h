// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <semaphore>
#include <set>
#include <thread>
#include <tuple>
#include <utility>
#include <vector>

#include "core/util/random.h"

namespace citylearn::simulation {

/// Virtual time since the start of the simulation.
using Time = std::chrono::nanoseconds;
inline Time from_seconds(double value) { return Time(static_cast<std::int64_t>(value * 1e9)); }

/// Unwinds a task that was killed. It is not a std::exception, so that the code under test does not catch it.
struct Killed {};

/// The work of one simulated process. It has a thread of its own, but only one task runs at a time.
class Task {
 public:
  explicit Task(std::uint64_t number) : number_(number) {}
  /// Returns whether it was killed. Nothing that it does from then on may have an effect.
  bool dead() const { return dead_; }
  bool ended() const { return state_ == State::kEnded; }

 private:
  friend class Scheduler;
  enum class State { kReady, kRunning, kWaiting, kEnded };
  const std::uint64_t number_;
  State state_ = State::kWaiting;
  bool dead_ = false;
  Time deadline_{}, stalled_until_{};
  std::binary_semaphore turn_{0};
  std::thread thread_;
};

/// Runs tasks one at a time, in an order drawn from a seed, under a virtual clock. The clock moves on to the next
/// deadline or event when every task waits, so nothing takes real time but computing. All methods are called by the
/// task that runs, by an event, or while run() does not run.
class Scheduler {
 public:
  explicit Scheduler(std::uint64_t seed);
  ~Scheduler() { end(); }
  Scheduler(const Scheduler&) = delete;
  Scheduler& operator=(const Scheduler&) = delete;

  Time now() const { return now_; }
  /// Returns the time to a task that asks. Each question takes a moment, so that a loop that only looks at the clock
  /// ends too.
  Time read_clock();
  /// Calls `event` at that time, which is now when it has passed. It must not wait.
  void at(Time time, std::function<void()> event);
  void after(Time delay, std::function<void()> event) { at(now_ + delay, std::move(event)); }

  /// Starts a task that calls `body`, which must catch all exceptions but Killed.
  Task& start(std::function<void()> body);
  /// Makes the running task wait until wake() or the time. Throws Killed when the task was killed.
  void wait_until(Time time);
  void wake(Task& task);
  /// Kills a task as SIGKILL does: it is unwound when it next waits, and dead() at once.
  void kill(Task& task);
  /// Leaves a task without processor time until then, as SIGSTOP does.
  void stall(Task& task, Time until);

  /// Kills what still runs and waits until it is unwound. No event happens any more.
  void end();

  /// Lets tasks run until all have ended (true) or the time has come (false).
  bool run(Time until);

  /// Adds to the hash of everything that happened.
  void note(std::uint64_t number);
  void note(const void* bytes, std::size_t count);
  std::uint64_t trace() const { return trace_; }
  std::uint64_t switches() const { return switches_; }

 private:
  void make_ready(Task& task);
  void set_waiting(Task& task, Time deadline);
  Task* choose();
  void hand_over(Task* next);
  void end_of_thread(Task& task);
  void join_ended();

  Random random_;
  Time now_{}, until_{};
  std::uint64_t order_ = 0, trace_ = 0xCBF29CE484222325ull, switches_ = 0;
  std::map<std::pair<Time, std::uint64_t>, std::function<void()>> events_;
  std::set<std::tuple<Time, std::uint64_t, Task*>> waiting_;  // by deadline and number
  std::vector<Task*> ready_;
  std::vector<std::unique_ptr<Task>> tasks_;
  std::binary_semaphore paused_{0};  // run() waits for it
};

}  // namespace citylearn::simulation
