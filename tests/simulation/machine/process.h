// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <string>

#include "core/util/machine.h"
#include "core/util/types.h"
#include "tests/simulation/machine/disk.h"
#include "tests/simulation/machine/scheduler.h"

namespace citylearn::simulation {

class Network;

/// A simulated process on a host of its own, which may be killed and started again. While its task runs, the thread's
/// Machine is this, and the system's clocks and files answer as they would there (system_calls.cc).
class Process : public Machine {
 public:
  using Body = std::function<int(const std::function<bool()>& stop)>;

  /// `body` runs the service until `stop` returns true, and returns its exit status.
  Process(std::string name, Scheduler& scheduler, Network& network, Body body)
      : name_(std::move(name)),
        scheduler_(scheduler),
        network_(network),
        body_(std::move(body)),
        disk_(std::make_shared<Disk>(name_)) {}

  const std::string& name() const { return name_; }
  Scheduler& scheduler() { return scheduler_; }
  Disk& disk() { return *disk_; }
  /// Lets it work in the folders of another one, as on a network file system.
  void share_disk(const Process& other) { disk_ = other.disk_; }

  void start();
  bool running() const { return task_ && !task_->ended(); }
  bool dead() const { return !task_ || task_->dead(); }
  void kill();
  /// The kinds of operations of a process.
  enum class Operation { kMessage, kFile };
  /// Kills it at one of its next operations, number `count` from now; a write is then torn. `new_file`: number
  /// `count` after it creates a file, and messages do not count.
  void kill_after(int count, bool new_file) { operations_left_ = count, files_only_ = awaits_file_ = new_file; }
  /// Takes the power from its host in the same way. It comes back with the next start.
  void lose_power_after(int count, bool new_file) { kill_after(count, new_file), power_ = false; }
  /// Notes that it creates a file.
  void created_file() { awaits_file_ = false; }
  /// Counts an operation. Returns false when the process is dead, so that nothing must come of it.
  bool operate(Operation operation);
  void stall(Time duration);
  void request_stop() { stop_ = true; }

  /// Returns the exit status when it ended by itself; -1 before, and after a kill.
  int status() const { return status_; }
  /// Returns what ended it, when that was an Error.
  const std::string& failure() const { return failure_; }
  int starts() const { return starts_; }

  /// Set its host's clocks: how many millionths the steady one runs faster, and by how much the date is wrong.
  void set_drift(int millionths) { drift_ = millionths; }
  void shift_date(Time by) { date_shift_ += by; }
  Time steady_clock() const;
  Time date() const;
  Time global_time(Clock::time_point local) const;

  /// Waits as the process's only thread does. Throws Killed.
  void wait_until(Clock::time_point deadline);
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
  std::shared_ptr<Disk> disk_;
  Task* task_ = nullptr;
  int starts_ = 0, status_ = -1, drift_ = 0, operations_left_ = 0;
  bool stop_ = false, power_ = true, files_only_ = false, awaits_file_ = false;
  Time date_shift_{};
  std::string failure_;
};

/// Returns the process that the calling thread runs; null outside of one.
Process* current_process();

}  // namespace citylearn::simulation
