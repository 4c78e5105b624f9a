// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "tests/simulation/network.h"
#include "tests/simulation/process.h"

namespace citylearn::simulation {

/// What goes wrong in a simulation, and how often: mean seconds between two faults of a kind; 0: there are none.
struct FaultRates {
  double kill = 0;          ///< of a process, while it waits
  double kill_at_work = 0;  ///< of a process, at one of its next messages or writes
  double partition = 0;     ///< nothing passes between two processes, for a while
  double one_way = 0;       ///< nothing passes from one process to another, for a while
  double stall = 0;         ///< a process gets no processor time, for a while
  double date_jump = 0;     ///< the date of a host changes by up to an hour
  int drift = 0;            ///< clocks run faster or slower by up to so many millionths
  LinkFaults links;         ///< of all messages
  double until = 60;        ///< seconds after which nothing goes wrong any more
};

/// Draws which faults there are, and how many of each. Seeds differ much, because some faults hide others.
FaultRates draw_faults(std::uint64_t seed);

/// Makes things go wrong, and starts processes again that were killed or failed, as a supervisor does.
class FaultInjector {
 public:
  FaultInjector(Scheduler& scheduler, Network& network, std::vector<Process*> processes, const FaultRates& rates,
                std::uint64_t seed);
  /// Nothing goes wrong from now on, and ended processes are left alone.
  void stop() { stopped_ = true; }
  const std::map<std::string, int>& counts() const { return counts_; }
  /// Called with each fault.
  std::function<void(const std::string&)> log;

 private:
  using Fault = std::function<void()>;
  void repeat(const std::string& name, double mean, const Fault& fault);
  void supervise(Process& process);
  void cut(bool both_ways);
  void note(const std::string& name, const std::string& text);
  Process& any() { return *processes_[random_.below(processes_.size())]; }
  Time exponential(double mean_seconds);

  Scheduler& scheduler_;
  Network& network_;
  const std::vector<Process*> processes_;
  const Time until_;
  Random random_;
  bool stopped_ = false;
  std::map<std::string, int> counts_;
  std::map<std::pair<std::string, std::string>, int> cuts_;  ///< how many are in force
};

}  // namespace citylearn::simulation
