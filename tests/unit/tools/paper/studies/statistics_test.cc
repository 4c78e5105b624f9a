// SPDX-License-Identifier: Apache-2.0
// Figures with intervals.
#include "tools/paper/studies/statistics.h"

#include <gtest/gtest.h>

#include <cmath>

namespace citylearn::paper {
namespace {

TEST(Statistics, MeansHaveStudentsInterval) {
  const Estimate estimate = of_mean({1, 2, 3, 4, 5});
  EXPECT_EQ(estimate.n, 5);
  EXPECT_DOUBLE_EQ(estimate.mean, 3);
  // t(0.975, 4) = 2.776445; s = sqrt(2.5).
  EXPECT_NEAR(estimate.high - 3, 2.776445 * std::sqrt(2.5 / 5), 1e-5);
  EXPECT_NEAR(estimate.low + estimate.high, 6, 1e-12);
}

TEST(Statistics, OneValueHasNoIntervalAndNoneNoMean) {
  EXPECT_DOUBLE_EQ(of_mean({7}).mean, 7);
  EXPECT_TRUE(std::isnan(of_mean({7}).low));
  EXPECT_TRUE(std::isnan(of_mean({}).mean));
  EXPECT_EQ(of_mean({NAN, 2, INFINITY, 4}).n, 2);
}

TEST(Statistics, SharesHaveWilsonsInterval) {
  const Estimate all = of_share(100, 100);
  EXPECT_DOUBLE_EQ(all.mean, 1);
  EXPECT_NEAR(all.low, 0.963, 0.001);  // not 1: a hundred successes prove no more
}

}  // namespace
}  // namespace citylearn::paper
