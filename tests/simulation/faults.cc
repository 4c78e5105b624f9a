// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults.h"

#include <cmath>

namespace citylearn::simulation {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;

constexpr milliseconds kSupervision{100};  // between two looks of the supervisor at a process
constexpr double kRestart = 0.5;           // mean seconds until a process is started again
constexpr double kOutage = 2;              // mean seconds of a partition or a stall
constexpr int kMostOperations = 40;        // until a process is killed at work

}  // namespace

FaultRates draw_faults(std::uint64_t seed) {
  Random random{seed, 0xFA17};
  const auto sometimes = [&random](double least, double most) {
    const double value = least * std::pow(most / least, random.uniform());
    return random.uniform() < 0.6 ? value : 0;
  };
  FaultRates rates;
  rates.kill = sometimes(2, 20);
  rates.kill_at_work = sometimes(2, 20);
  rates.partition = sometimes(4, 30);
  rates.one_way = sometimes(4, 30);
  rates.stall = sometimes(4, 30);
  rates.date_jump = sometimes(5, 30);
  rates.drift = static_cast<int>(sometimes(10, 20'000));
  rates.links.loss = sometimes(0.001, 0.2);
  rates.links.repetition = sometimes(0.001, 0.1);
  rates.links.reordering = sometimes(0.001, 0.2);
  rates.links.slow = sometimes(0.001, 0.1);
  rates.links.latency = from_seconds(1e-3 * std::pow(20, random.uniform()));
  return rates;
}

FaultInjector::FaultInjector(Scheduler& scheduler, Network& network, std::vector<Process*> processes,
                             const FaultRates& rates, std::uint64_t seed)
    : scheduler_(scheduler),
      network_(network),
      processes_(std::move(processes)),
      until_(from_seconds(rates.until)),
      random_({seed, 0x1213}) {
  network_.faults = rates.links;
  scheduler_.at(until_, [this] { network_.faults = LinkFaults(); });
  for (Process* process : processes_) {
    if (rates.drift > 0)
      process->set_drift(static_cast<int>(random_.below(2 * static_cast<std::uint64_t>(rates.drift) + 1)) -
                         rates.drift);
    supervise(*process);
  }
  repeat("kill", rates.kill, [this] {
    Process& process = any();
    if (!process.running()) return;
    note("kill", process.name());
    process.kill();
  });
  repeat("kill at work", rates.kill_at_work, [this] {
    Process& process = any();
    if (!process.running()) return;
    const int operations = 1 + static_cast<int>(random_.below(kMostOperations));
    note("kill at work", process.name() + " after " + std::to_string(operations) + " operations");
    process.kill_after(operations);
  });
  repeat("partition", rates.partition, [this] { cut(true); });
  repeat("one way", rates.one_way, [this] { cut(false); });
  repeat("stall", rates.stall, [this] {
    Process& process = any();
    const Time duration = exponential(kOutage);
    if (!process.running()) return;
    note("stall", process.name() + " for " + std::to_string(duration / milliseconds(1)) + " ms");
    process.stall(duration);
  });
  repeat("date jump", rates.date_jump, [this] {
    Process& process = any();
    const Time by = from_seconds((random_.uniform() * 2 - 1) * 3600);
    note("date jump", process.name() + " by " + std::to_string(by / seconds(1)) + " s");
    process.shift_date(by);
  });
}

Time FaultInjector::exponential(double mean_seconds) {
  return from_seconds(-std::log(1 - random_.uniform()) * mean_seconds);
}

void FaultInjector::note(const std::string& name, const std::string& text) {
  ++counts_[name];
  scheduler_.note(text.data(), text.size());
  if (log) log(name + ": " + text);
}

void FaultInjector::repeat(const std::string& name, double mean, const Fault& fault) {
  if (mean <= 0) return;
  scheduler_.after(exponential(mean), [this, name, mean, fault] {
    if (stopped_ || scheduler_.now() >= until_) return;
    fault();
    repeat(name, mean, fault);
  });
}

/// A process that ended with status 0 has done its work; one that failed or was killed is started again.
void FaultInjector::supervise(Process& process) {
  const bool down = process.starts() > 0 && !process.running() && process.status() != 0;
  scheduler_.after(down ? exponential(kRestart) : Time(kSupervision), [this, &process, down] {
    if (stopped_) return;
    if (down && !process.running()) {
      if (!process.failure().empty()) note("failure", process.name() + ": " + process.failure());
      if (log) log("start: " + process.name());
      process.start();
    }
    supervise(process);
  });
}

void FaultInjector::cut(bool both_ways) {
  const std::string from = any().name(), to = any().name();
  const Time duration = exponential(kOutage);
  if (from == to) return;
  note(both_ways ? "partition" : "one way",
       from + (both_ways ? " and " : " to ") + to + " for " + std::to_string(duration / milliseconds(1)) + " ms");
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
  scheduler_.after(duration, [all] { all(-1); });
}

}  // namespace citylearn::simulation
