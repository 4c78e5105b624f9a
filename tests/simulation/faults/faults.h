// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "tests/simulation/faults/fault_rates.h"
#include "tests/simulation/machine/network.h"
#include "tests/simulation/machine/process.h"

namespace citylearn::simulation {

/// Makes things go wrong, and starts processes again that were killed or failed, as a supervisor does. What it draws
/// for one kind of fault does not depend on the others, so that a kind can be left out.
class FaultInjector {
 public:
  /// `twins` are the processes that have the id of another one. They run for a while now and then.
  FaultInjector(Scheduler& scheduler, Network& network, std::vector<Process*> processes, std::vector<Process*> twins,
                const FaultRates& rates, std::uint64_t seed);
  /// Nothing goes wrong from now on, what is wrong is mended, and ended processes are left alone.
  void stop();
  const std::map<std::string, int>& counts() const { return counts_; }
  /// Returns the errors with which processes ended that had no reason to: each "process: error".
  const std::vector<std::string>& unexpected_errors() const { return unexpected_errors_; }
  /// Called with each fault.
  std::function<void(const std::string&)> log;

 private:
  using Fault = std::function<void(Random&)>;
  void repeat(const std::string& name, double mean, const Fault& fault);
  void supervise(Process& process);
  void cut(Random& random, const std::string& name, bool both_ways);
  void fill_disk(Random& random);
  void run_twin(Random& random);
  void judge(const Process& process);
  void note(const std::string& name, const std::string& text);
  Process& any(Random& random) { return *processes_[random.below(processes_.size())]; }

  Scheduler& scheduler_;
  Network& network_;
  const std::vector<Process*> processes_;
  std::vector<Process*> twins_, mortal_;  ///< mortal_: those that are killed
  const std::uint64_t seed_;
  const Time until_;
  bool stopped_ = false;
  std::map<std::string, int> counts_;
  std::map<std::string, Random> randoms_;                    ///< by kind of fault, or process
  std::map<std::pair<std::string, std::string>, int> cuts_;  ///< how many are in force
  std::map<const Process*, Time> full_until_;                ///< until when its disk is or was full
  std::vector<std::string> unexpected_errors_;
};

}  // namespace citylearn::simulation
