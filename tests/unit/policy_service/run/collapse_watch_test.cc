// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/collapse_watch.h"

#include <gtest/gtest.h>

namespace citylearn::testing {
namespace {

TEST(CollapseWatch, KnowsTheBestOfAnEarlierProcess) {
  EXPECT_TRUE(CollapseWatch(0.9).collapsed(0.4));
  EXPECT_FALSE(CollapseWatch(0.9).collapsed(0.5));
}

TEST(CollapseWatch, SeesAFallFromAGoodAgentAndItsRecovery) {
  CollapseWatch watch;
  for (const double spl : {0.2, 0.05, 0.49, 0.1}) EXPECT_FALSE(watch.collapsed(spl)) << "never was good: " << spl;
  for (const double spl : {0.9, 1.0, 0.6, 0.5}) EXPECT_FALSE(watch.collapsed(spl)) << spl;
  EXPECT_TRUE(watch.collapsed(0.49));
  EXPECT_TRUE(watch.collapsed(0.79)) << "not yet what it was";
  EXPECT_FALSE(watch.collapsed(0.8));
  EXPECT_FALSE(watch.collapsed(0.6));
  EXPECT_EQ(watch.best(), 1.0);
}

}  // namespace
}  // namespace citylearn::testing
