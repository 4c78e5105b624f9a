// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/faults/fault_rates.h"

#include <gtest/gtest.h>

#include "core/util/error.h"

namespace citylearn::simulation {
namespace {

TEST(FaultRates, KindsCanBeLeftOutAndUnknownOnesAreErrors) {
  FaultRates rates;
  rates.kill = rates.links.loss = 1;
  rates.leave_out("loss");
  EXPECT_EQ(rates.kill, 1);
  EXPECT_EQ(rates.links.loss, 0);
  EXPECT_THROW(rates.leave_out("earthquake"), Error);
}

}  // namespace
}  // namespace citylearn::simulation
