// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/belief/motion.h"

#include <gtest/gtest.h>

namespace citylearn::testing {
namespace {

TEST(Motion, TempersEvidenceByTheStepsSinceWhatIsCertain) {
  EXPECT_EQ(Motion<double>(0, 0).later(40), 41);
  EXPECT_DOUBLE_EQ(Motion<double>(0.125, 0).later(0), 0.8);
  EXPECT_DOUBLE_EQ(Motion<double>(0.125, 0).later(4), 4) << "stays below 1 / 2p";
  EXPECT_DOUBLE_EQ(Motion<double>(0, 0.0625).later(2), 2) << "and below 1 / 2 sqrt(k)";
  EXPECT_DOUBLE_EQ(Motion<double>(0.25, 0.0625).later(1), 1) << "mishaps of both kinds add up";
}

TEST(Motion, TempersAsCheckpointsOfBeforeDid) {
  EXPECT_DOUBLE_EQ(Motion<double>(0.1, 0, TemperingLimit::kAnyMishap).later(9), 9);
  EXPECT_DOUBLE_EQ(Motion<double>(0.1, 0.04, TemperingLimit::kAnyMishap).later(4), 4);
  EXPECT_EQ(Motion<double>(0.1, 0, TemperingLimit::kKidnappings).later(9), 10);
  EXPECT_DOUBLE_EQ(Motion<double>(0.5, 0.04, TemperingLimit::kKidnappings).later(4), 4);
}

}  // namespace
}  // namespace citylearn::testing
