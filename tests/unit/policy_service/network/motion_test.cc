// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/motion.h"

#include <gtest/gtest.h>

namespace citylearn::testing {
namespace {

TEST(Motion, TempersEvidenceByTheStepsSinceWhatIsCertain) {
  EXPECT_EQ(Motion<double>(0, 0).later(40), 41);
  EXPECT_DOUBLE_EQ(Motion<double>(0.1, 0).later(0), 0.9);
  EXPECT_DOUBLE_EQ(Motion<double>(0.1, 0).later(9), 9) << "stays below 1 / p";
  EXPECT_DOUBLE_EQ(Motion<double>(0.1, 0.04).later(4), 4) << "and below 1 / sqrt(k)";
  EXPECT_EQ(Motion<double>(0.1, 0, false).later(9), 10) << "in checkpoints of before";
  EXPECT_DOUBLE_EQ(Motion<double>(0.5, 0.04, false).later(4), 4);
}

}  // namespace
}  // namespace citylearn::testing
