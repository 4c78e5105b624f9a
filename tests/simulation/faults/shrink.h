// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "tests/simulation/faults/fault_rates.h"

namespace citylearn::simulation {

/// A smaller set of the faults that a seed draws.
struct FewerFaults {
  std::vector<std::string> left_out;  ///< kinds
  double until = 0;                   ///< as in FaultRates; 0: as drawn

  void apply(FaultRates& rates) const;
  /// Returns the options that choose it: " --leave-out kill,loss --until 7.5".
  std::string options() const;
};

/// Looks for a smaller set of faults for which `fails` is still true: leaves out kinds one by one until none can be
/// spared, and ends the faults earlier. Calls `fails` some dozen times.
FewerFaults shrink(const FaultRates& rates, const std::function<bool(const FewerFaults&)>& fails);

}  // namespace citylearn::simulation
