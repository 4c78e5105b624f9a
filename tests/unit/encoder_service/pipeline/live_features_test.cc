// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/live_features.h"

#include <gtest/gtest.h>

#include "core/util/error.h"

namespace citylearn {
namespace {

const ReductionOptions kAsTheyAre = {.centring = Centring::kNone, .dimension = 0};

TEST(LiveFeatures, APictureThatCannotBeReadLooksLikeTheOneBefore) {
  LiveFeatures features(kAsTheyAre, nullptr, 2);
  EXPECT_EQ(features.dimension(), 2);
  EXPECT_EQ(features.find(7), nullptr);
  features.put_bad(7);
  features.put(8, Eigen::Vector2f(1, 2));
  features.put_bad(9);
  EXPECT_EQ(features.find(7)[1], 0);
  EXPECT_EQ(features.find(8)[1], 2);
  EXPECT_EQ(features.find(9)[1], 2);
}

TEST(LiveFeatures, TheNewestAreKept) {
  LiveFeatures features(kAsTheyAre, nullptr, 2);
  for (int frame = 0; frame < 1000; ++frame) features.put(frame, Eigen::Vector2f(static_cast<float>(frame), 0));
  EXPECT_EQ(features.find(0), nullptr);
  ASSERT_NE(features.find(999), nullptr);
  EXPECT_EQ(features.find(999)[0], 999);
}

TEST(LiveFeatures, RefusesWhatNeedsTheWholeTraversal) {
  EXPECT_THROW(LiveFeatures({.centring = Centring::kOwn, .dimension = 0}, nullptr, 2), Error);
}

}  // namespace
}  // namespace citylearn
