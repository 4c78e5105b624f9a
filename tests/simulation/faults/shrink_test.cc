// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults/shrink.h"

#include <gtest/gtest.h>

#include "core/util/error.h"

namespace citylearn::simulation {
namespace {

TEST(Shrink, LeavesTheFaultsThatItTakes) {
  FaultRates rates;
  rates.kill = rates.stall = rates.partition = rates.links.loss = 1;
  // It takes kills and loss, and ten seconds of them.
  const auto fails = [&rates](const FewerFaults& fewer) {
    FaultRates left = rates;
    fewer.apply(left);
    return left.kill > 0 && left.links.loss > 0 && left.until >= 10;
  };
  const FewerFaults fewer = shrink(rates, fails);
  EXPECT_TRUE(fails(fewer));
  FaultRates left = rates;
  fewer.apply(left);
  EXPECT_EQ(left.kinds(), (std::vector<std::string>{"kill", "loss"}));
  EXPECT_LT(left.until, 11);
  EXPECT_EQ(fewer.options(), " --leave-out partition,stall --until 10.3125");
}

TEST(Shrink, KeepsEverythingWhenEverythingIsNeeded) {
  FaultRates rates;
  rates.kill = rates.stall = 1;
  const FewerFaults fewer = shrink(rates, [](const FewerFaults& less) { return less.options().empty(); });
  EXPECT_EQ(fewer.options(), "");
}

TEST(FaultRates, UnknownKindsAreErrors) {
  FaultRates rates;
  EXPECT_THROW(rates.leave_out("earthquake"), Error);
}

}  // namespace
}  // namespace citylearn::simulation
