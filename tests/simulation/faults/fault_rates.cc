// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults/fault_rates.h"

#include <cmath>
#include <utility>
#include <vector>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn::simulation {
namespace {

/// Returns the name of each kind of fault and its rate's place.
std::vector<std::pair<std::string, double*>> rates_of(FaultRates& rates) {
  return {{"kill", &rates.kill},
          {"kill_at_work", &rates.kill_at_work},
          {"partition", &rates.partition},
          {"one_way", &rates.one_way},
          {"stall", &rates.stall},
          {"date_jump", &rates.date_jump},
          {"power", &rates.power},
          {"full_disk", &rates.full_disk},
          {"twin", &rates.twin},
          {"drift", &rates.drift},
          {"loss", &rates.links.loss},
          {"repetition", &rates.links.repetition},
          {"reordering", &rates.links.reordering},
          {"slow", &rates.links.slow},
          {"corruption", &rates.links.corruption}};
}

}  // namespace

void FaultRates::leave_out(const std::string& kind) {
  std::string known;
  for (const auto& [name, rate] : rates_of(*this)) {
    if (name == kind) {
      *rate = 0;
      return;
    }
    known += (known.empty() ? "" : ", ") + name;
  }
  throw Error("there are no such faults", kind, "known are " + known);
}

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
  rates.drift = sometimes(10, 20'000);
  rates.links.loss = sometimes(0.001, 0.2);
  rates.links.repetition = sometimes(0.001, 0.1);
  rates.links.reordering = sometimes(0.001, 0.2);
  rates.links.slow = sometimes(0.001, 0.1);
  rates.power = sometimes(4, 30);
  rates.full_disk = sometimes(5, 30);
  rates.twin = sometimes(8, 30);
  rates.links.corruption = sometimes(0.0001, 0.02);
  rates.spare_envs = random.uniform() < 0.3;
  rates.links.latency = from_seconds(1e-3 * std::pow(20, random.uniform()));
  return rates;
}

}  // namespace citylearn::simulation
