// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "core/util/machine.h"
#include "core/util/types.h"
#include "tests/simulation/scheduler.h"

namespace citylearn::simulation {

class Network;

/// A simulated process on a host of its own, which may be killed and started again. While its task runs, the thread's
/// Machine is this, and the system's clocks and files answer as they would there (system_calls.cc).
class Process : public Machine {
 public:
  using Body = std::function<int(const std::function<bool()>& stop)>;

  /// `body` runs the service until `stop` returns true, and returns its exit status.
  Process(std::string name, Scheduler& scheduler, Network& network, Body body)
      : name_(std::move(name)), scheduler_(scheduler), network_(network), body_(std::move(body)) {}

  const std::string& name() const { return name_; }
  Scheduler& scheduler() { return scheduler_; }

  void start();
  bool running() const { return task_ && !task_->ended(); }
  bool dead() const { return !task_ || task_->dead(); }
  void kill();
  /// Kills it at one of its next messages or writes to a file, number `operations` from now; a write is then torn.
  void kill_after(int operations) { operations_left_ = operations; }
  /// Counts one of them. Returns false when the process is dead, so that nothing must come of it.
  bool operate();
  void stall(Time duration);
  void request_stop() { stop_ = true; }

  /// Returns the exit status when it ended by itself; -1 before, and after a kill.
  int status() const { return status_; }
  /// Returns what ended it, when that was an Error.
  const std::string& failure() const { return failure_; }
  int starts() const { return starts_; }

  /// Its host's clocks: the steady one runs faster or slower by so many millionths, and the date is off by so much.
  void set_drift(int millionths) { drift_ = millionths; }
  void shift_date(Time by) { date_shift_ += by; }
  Time steady_clock() const;
  Time date() const;
  Time global_time(Clock::time_point local) const;

  /// Waits as the process's only thread does. Throws Killed.
  void wait_until(Clock::time_point deadline) { scheduler_.wait_until(global_time(deadline)); }
  void wake();

  std::string host_name() override { return "host-of-" + name_; }
  int process_number() override { return starts_; }
  bool stop_requested() override { return stop_; }
  std::unique_ptr<Middleware> create_middleware(const MiddlewareOptions& options) override;

 private:
  const std::string name_;
  Scheduler& scheduler_;
  Network& network_;
  const Body body_;
  Task* task_ = nullptr;
  int starts_ = 0, status_ = -1, drift_ = 0, operations_left_ = 0;
  bool stop_ = false;
  Time date_shift_{};
  std::string failure_;
};

/// Returns the process that the calling thread runs; null outside of one.
Process* current_process();

}  // namespace citylearn::simulation
