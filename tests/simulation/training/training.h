// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "tests/simulation/faults/faults.h"
#include "tests/simulation/training/layout.h"

namespace citylearn::simulation {

/// A training of the services' own code, and what goes wrong meanwhile.
struct Scenario {
  std::uint64_t seed = 1;  ///< of the order of everything; the training itself has a seed of its own
  Layout layout = layouts().front();
  int checkpoint_every = 5;  ///< updates
  FaultRates faults;
  std::string expected_agent;  ///< Outcome::agent of the training without faults; empty: unknown
  /// Seconds after the last fault by which all services have come to rest.
  double patience = 120;
  /// Called with each fault and each end of a process.
  std::function<void(const std::string&)> log;
};

struct Outcome {
  std::vector<std::string> violations;  ///< of invariants, each "name: what was seen"
  std::uint64_t trace = 0;              ///< hash of every message, every write and the order of everything
  double seconds = 0;                   ///< of virtual time
  std::uint64_t switches = 0;
  std::uint64_t episodes = 0;         ///< acknowledged
  std::string agent;                  ///< hash of the trained agent
  std::map<std::string, int> faults;  ///< by kind
  std::map<std::string, Traffic> traffic;
};

/// Plays it in the current folder, which must be empty. The outcome depends on the scenario alone.
Outcome play(const Scenario& scenario);

}  // namespace citylearn::simulation
