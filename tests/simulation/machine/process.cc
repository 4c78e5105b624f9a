// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/machine/process.h"

#include <exception>

#include "core/dds/middleware.h"
#include "tests/simulation/machine/network.h"

namespace citylearn::simulation {
namespace {

constexpr Time kBoot = std::chrono::hours(24);                // what the steady clock shows at the start
constexpr Time kBegin = std::chrono::seconds(1'790'000'000);  // the date at the start
constexpr std::int64_t kMillion = 1'000'000;
__extension__ using Wide = __int128;

thread_local Process* current = nullptr;

}  // namespace

Process* current_process() { return current; }

void Process::start() {
  disk_->power_on();
  ++starts_;
  status_ = -1;
  operations_left_ = 0;
  files_only_ = awaits_file_ = false;
  power_ = true;
  failure_.clear();
  stop_ = false;
  task_ = &scheduler_.start([this] {
    current = this;
    Machine::simulate(this);
    int status = -1;
    std::string failure;
    try {
      status = body_([this] { return stop_; });
    } catch (const std::exception& error) {
      status = 1;
      failure = error.what();
    }
    if (dead()) return;  // nobody sees what a killed process says
    status_ = status;
    failure_ = failure;
  });
}

void Process::kill() {
  if (running()) scheduler_.kill(*task_);
}

bool Process::operate(Operation operation) {
  if (dead()) return false;
  if (operations_left_ == 0 || awaits_file_ || (files_only_ && operation != Operation::kFile) || --operations_left_ > 0)
    return true;
  kill();
  if (!power_) disk_->power_off();
  return false;
}

void Process::stall(Time duration) {
  if (running()) scheduler_.stall(*task_, scheduler_.now() + duration);
}

void Process::wait_until(Clock::time_point deadline) { scheduler_.wait_until(global_time(deadline)); }

void Process::wake() {
  if (running()) scheduler_.wake(*task_);
}

Time Process::steady_clock() const {
  const Time now = scheduler_.read_clock();
  return kBoot + now + now * drift_ / kMillion;
}

Time Process::date() const { return kBegin + scheduler_.now() + date_shift_; }

/// Returns the time of the simulation at which this host's steady clock shows `local`, a moment later at most.
Time Process::global_time(Clock::time_point local) const {
  const Time since = local.time_since_epoch();
  if (since <= kBoot) return Time(0);
  if (since > Time::max() / 2) return Time::max();
  return Time(static_cast<std::int64_t>(Wide((since - kBoot).count()) * kMillion / (kMillion + drift_)) + 2);
}

std::unique_ptr<Middleware> Process::create_middleware(const MiddlewareOptions&) { return network_.join(*this); }

}  // namespace citylearn::simulation
