// SPDX-License-Identifier: Apache-2.0
#include "core/task/lost.h"

#include <gtest/gtest.h>

namespace citylearn::testing {
namespace {

/// Watches beliefs in two places.
class Watched : public ::testing::Test {
 protected:
  bool says_lost(std::uint32_t likeliest, double lost, std::uint32_t other = 0, float other_probability = 0) {
    const std::uint32_t places[] = {likeliest, other};
    const float probabilities[] = {0.25f, other_probability};
    return watch_.says_lost(places, probabilities, lost, kMaxLost);
  }
  LostWatch watch_;
};

TEST_F(Watched, SaysSoWhileItIsLostAgain) {
  EXPECT_FALSE(says_lost(10, 0.75)) << "it has not found itself yet";
  EXPECT_FALSE(says_lost(10, 0.7));
  EXPECT_TRUE(says_lost(10, 0.75));
  watch_.forget();
  EXPECT_TRUE(says_lost(10, 0.75));
  watch_.reset();
  EXPECT_FALSE(says_lost(10, 0.75)) << "another episode";
}

TEST_F(Watched, SaysSoWhereItLeapsToWhatItDidNotExpect) {
  EXPECT_FALSE(says_lost(10, 0.25, 50, 0.0625f));
  EXPECT_FALSE(says_lost(13, 0.5)) << "a slip leads there";
  EXPECT_TRUE(says_lost(50, 0.5)) << "what it believed when it was surest counts";
  EXPECT_FALSE(says_lost(51, 0.5));
  EXPECT_TRUE(says_lost(10, 0.125)) << "it had not reckoned with going back";
  watch_.reset();
  EXPECT_FALSE(says_lost(50, 0.25)) << "another episode";
}

TEST_F(Watched, FindsItselfWhereItReckonedWith) {
  EXPECT_FALSE(says_lost(10, 0.25, 50, 0.125f));
  EXPECT_FALSE(says_lost(11, 0.5));
  EXPECT_FALSE(says_lost(55, 0.25)) << "50 and two steps of two places, and one";
  watch_.reset();
  EXPECT_FALSE(says_lost(10, 0.25, 50, 0.125f));
  EXPECT_TRUE(says_lost(54, 0.25)) << "50 and one step of two places is 52";
  watch_.reset();
  EXPECT_FALSE(says_lost(10, 0.25, 13, 0.5f));
  EXPECT_TRUE(says_lost(14, 0.25)) << "13 is where it was, not another place";
  watch_.reset();
  EXPECT_FALSE(says_lost(10, 0.75));
  EXPECT_FALSE(says_lost(50, 0.25)) << "it was never found before";
}

}  // namespace
}  // namespace citylearn::testing
