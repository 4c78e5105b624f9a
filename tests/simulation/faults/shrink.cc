// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults/shrink.h"

#include <sstream>

namespace citylearn::simulation {
namespace {

constexpr int kHalvings = 6;  // of the time in which faults end

/// Returns whether a kind could be left out.
bool leave_out_one(std::vector<std::string>& kinds, FewerFaults& fewer,
                   const std::function<bool(const FewerFaults&)>& fails) {
  bool spared = false;
  for (auto kind = kinds.begin(); kind != kinds.end();) {
    FewerFaults candidate = fewer;
    candidate.left_out.push_back(*kind);
    if (!fails(candidate)) {
      ++kind;
      continue;
    }
    fewer = candidate;
    kind = kinds.erase(kind);
    spared = true;
  }
  return spared;
}

}  // namespace

void FewerFaults::apply(FaultRates& rates) const {
  for (const std::string& kind : left_out) rates.leave_out(kind);
  if (until > 0) rates.until = until;
}

std::string FewerFaults::options() const {
  std::ostringstream out;
  for (std::size_t i = 0; i < left_out.size(); ++i) out << (i == 0 ? " --leave-out " : ",") << left_out[i];
  if (until > 0) out << " --until " << until;
  return out.str();
}

FewerFaults shrink(const FaultRates& rates, const std::function<bool(const FewerFaults&)>& fails) {
  FewerFaults fewer;
  std::vector<std::string> kinds = rates.kinds();
  while (leave_out_one(kinds, fewer, fails)) continue;
  double enough = rates.until, too_few = 0;
  for (int i = 0; i < kHalvings; ++i) {
    FewerFaults candidate = fewer;
    candidate.until = (enough + too_few) / 2;
    if (fails(candidate)) {
      fewer = candidate;
      enough = candidate.until;
    } else {
      too_few = candidate.until;
    }
  }
  return fewer;
}

}  // namespace citylearn::simulation
