// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults/faults.h"

#include <algorithm>
#include <cmath>

namespace citylearn::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kSupervision{100};  // between two looks of the supervisor at a process
constexpr double kRestart = 0.5;           // mean seconds until a process is started again
constexpr double kOutage = 2;              // mean seconds of a partition, a stall or a full disk
constexpr double kTwin = 4;                // mean seconds that a second process of an id runs
constexpr std::uint64_t kMaxRoom = 8192;   // bytes that a disk still takes when it fills up
constexpr int kMaxOperationsAtStart = 5;   // at a new file, until a process is killed
constexpr int kMaxOperations = 40;         // until a process is killed at work

double seconds_of(Random& random, double mean) { return -std::log(1 - random.uniform()) * mean; }

Time exponential(Random& random, double mean) { return from_seconds(seconds_of(random, mean)); }

std::string in_ms(Time duration) { return std::to_string(duration / milliseconds(1)) + " ms"; }

}  // namespace

FaultInjector::FaultInjector(Scheduler& scheduler, Network& network, std::vector<Process*> processes,
                             std::vector<Process*> twins, const FaultRates& rates, std::uint64_t seed)
    : scheduler_(scheduler),
      network_(network),
      processes_(std::move(processes)),
      twins_(std::move(twins)),
      seed_(seed),
      until_(from_seconds(rates.until)) {
  network_.faults = rates.links;
  scheduler_.at(until_, [this] { network_.faults = LinkFaults(); });
  for (Process* process : processes_) {
    Random random{seed_, std::hash<std::string>{}(process->name())};
    if (rates.drift > 0) process->set_drift(static_cast<int>((random.uniform() * 2 - 1) * rates.drift));
    if (rates.power > 0) process->disk().remember_changes(random.next());
    supervise(*process);
  }
  for (Process* process : processes_)
    if (!rates.spare_envs || !process->name().starts_with("env-")) mortal_.push_back(process);
  repeat("kill", rates.kill, [this](Random& random) {
    Process& process = *mortal_[random.below(mortal_.size())];
    if (!process.running()) return;
    note("kill", process.name());
    process.kill();
  });
  const auto at_work = [this](const char* name, void (Process::*end)(int, bool)) {
    return [this, name, end](Random& random) {
      Process& process = *mortal_[random.below(mortal_.size())];
      const std::uint64_t draw = random.next();
      const bool new_file = random.below(2) == 0;
      const int operations =
          1 + static_cast<int>(draw % static_cast<std::uint64_t>(new_file ? kMaxOperationsAtStart : kMaxOperations));
      if (!process.running()) return;
      note(name, process.name() + " after " + std::to_string(operations) + " operations" +
                     (new_file ? " of a new file" : ""));
      (process.*end)(operations, new_file);
    };
  };
  repeat("kill_at_work", rates.kill_at_work, at_work("kill_at_work", &Process::kill_after));
  repeat("power", rates.power, at_work("power", &Process::lose_power_after));
  repeat("partition", rates.partition, [this](Random& random) { cut(random, "partition", true); });
  repeat("one_way", rates.one_way, [this](Random& random) { cut(random, "one_way", false); });
  repeat("stall", rates.stall, [this](Random& random) {
    Process& process = any(random);
    const Time duration = exponential(random, kOutage);
    if (!process.running()) return;
    note("stall", process.name() + " for " + in_ms(duration));
    process.stall(duration);
  });
  repeat("date_jump", rates.date_jump, [this](Random& random) {
    Process& process = any(random);
    const Time by = from_seconds((random.uniform() * 2 - 1) * 3600);
    note("date_jump", process.name() + " by " + std::to_string(by / seconds(1)) + " s");
    process.shift_date(by);
  });
  repeat("full_disk", rates.full_disk, [this](Random& random) { fill_disk(random); });
  if (rates.spare_envs) std::erase_if(twins_, [](const Process* twin) { return twin->name().starts_with("env-"); });
  if (!twins_.empty()) repeat("twin", rates.twin, [this](Random& random) { run_twin(random); });
}

void FaultInjector::stop() {
  stopped_ = true;
  network_.faults = LinkFaults();
  network_.mend_all();
  for (Process* process : processes_) {
    process->disk().empty();
    process->kill_after(0, false);  // not any more
    process->stall(Time(0));
    process->wake();
  }
}

void FaultInjector::note(const std::string& name, const std::string& text) {
  ++counts_[name];
  scheduler_.note(text.data(), text.size());
  if (log) log(name + ": " + text);
}

void FaultInjector::repeat(const std::string& name, double mean, const Fault& fault) {
  if (mean <= 0) return;
  Random& random = randoms_.try_emplace(name, Random{seed_, std::hash<std::string>{}(name)}).first->second;
  scheduler_.after(exponential(random, mean), [this, name, mean, fault, &random] {
    if (stopped_ || scheduler_.now() >= until_) return;
    fault(random);
    repeat(name, mean, fault);
  });
}

/// Keeps the error of a process that ended by itself, unless its disk was full or another process has its id.
void FaultInjector::judge(const Process& process) {
  const std::string& error = process.failure();
  if (error.empty()) return;
  note("failure", process.name() + ": " + error);
  const auto full = full_until_.find(&process);
  if (full != full_until_.end() && scheduler_.now() < full->second + seconds(1)) return;
  for (const char* known : {"already runs in session", "another policy_service writes here"})
    if (error.find(known) != error.npos) return;
  unexpected_errors_.push_back(process.name() + ": " + error);
}

/// A process that ended with status 0 has done its work; one that failed or was killed is started again.
void FaultInjector::supervise(Process& process) {
  Random& random =
      randoms_.try_emplace(process.name(), Random{seed_, 1, std::hash<std::string>{}(process.name())}).first->second;
  const bool down = process.starts() > 0 && !process.running() && process.status() != 0;
  if (down) judge(process);
  scheduler_.after(down ? exponential(random, kRestart) : Time(kSupervision), [this, &process, down] {
    if (stopped_) return;
    if (down && !process.running()) {
      if (log) log("start: " + process.name());
      process.start();
    }
    supervise(process);
  });
}

void FaultInjector::cut(Random& random, const std::string& name, bool both_ways) {
  const std::string from = any(random).name(), to = any(random).name();
  const Time duration = exponential(random, kOutage);
  if (from == to) return;
  note(name, from + (both_ways ? " and " : " to ") + to + " for " + in_ms(duration));
  const auto change = [this](const std::string& sender, const std::string& receiver, int by) {
    int& count = cuts_[{sender, receiver}];
    count += by;
    if (count > 0)
      network_.cut(sender, receiver);
    else
      network_.mend(sender, receiver);
  };
  const auto all = [=](int by) {
    change(from, to, by);
    if (both_ways) change(to, from, by);
  };
  all(1);
  scheduler_.after(duration, [this, all] {
    if (!stopped_) all(-1);  // else all is mended
  });
}

void FaultInjector::fill_disk(Random& random) {
  Process& process = any(random);
  const Time duration = exponential(random, kOutage);
  note("full_disk", "of " + process.name() + " for " + in_ms(duration));
  process.disk().fill(random.below(kMaxRoom));
  Time& until = full_until_[&process];
  until = std::max(until, scheduler_.now() + duration);
  scheduler_.at(until, [this, &process] {
    if (scheduler_.now() >= full_until_[&process]) process.disk().empty();
  });
}

void FaultInjector::run_twin(Random& random) {
  Process& twin = *twins_[random.below(twins_.size())];
  const Time duration = exponential(random, kTwin);
  if (twin.running()) return;
  note("twin", twin.name() + " for " + in_ms(duration));
  twin.start();
  scheduler_.after(duration, [&twin] { twin.kill(); });
}

}  // namespace citylearn::simulation
