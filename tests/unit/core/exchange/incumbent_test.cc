// SPDX-License-Identifier: Apache-2.0
#include "core/exchange/incumbent.h"

#include <gtest/gtest.h>

namespace citylearn {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Heard = Incumbent::Heard;

constexpr std::uint64_t kFirst = 500, kEarlier = 1, kLater = 900;

class IncumbentTest : public ::testing::Test {
 protected:
  IncumbentTest() { incumbent_.hear(kFirst, now_); }
  Heard hear(std::uint64_t incarnation, milliseconds after = milliseconds(0)) {
    return incumbent_.hear(incarnation, now_ += after);
  }
  Clock::time_point now_ = Clock::now();
  Incumbent incumbent_;
};

TEST_F(IncumbentTest, TheFirstStaysWhileItIsHeardWhateverItsNumber) {
  for (int beat = 0; beat < 30; ++beat) {
    EXPECT_EQ(hear(kEarlier, milliseconds(300)), Heard::kOther);
    EXPECT_EQ(hear(kLater, milliseconds(300)), Heard::kOther);
    EXPECT_EQ(hear(kFirst, milliseconds(400)), Heard::kIncumbent);
  }
  EXPECT_EQ(hear(0), Heard::kOther) << "the number of no process";
}

TEST_F(IncumbentTest, AnotherFollowsASilentOneAfterAWhile) {
  for (const std::uint64_t next : {kEarlier, kLater}) {
    const std::uint64_t before = incumbent_.incarnation();
    EXPECT_EQ(hear(next, milliseconds(100)), Heard::kOther);
    EXPECT_EQ(hear(next, kHandover - milliseconds(1)), Heard::kOther);
    EXPECT_EQ(hear(next, milliseconds(1)), Heard::kSuccessor);
    EXPECT_EQ(hear(next), Heard::kIncumbent);
    EXPECT_TRUE(incumbent_.preceded(before));
    EXPECT_FALSE(incumbent_.preceded(next));
  }
}

TEST_F(IncumbentTest, OneMessageOfADeadProcessReplacesNobody) {
  EXPECT_EQ(hear(kLater, milliseconds(100)), Heard::kOther);
  EXPECT_EQ(hear(kFirst, kHandover), Heard::kIncumbent);
  EXPECT_EQ(hear(kLater, milliseconds(100)), Heard::kOther) << "it is heard anew";
}

TEST_F(IncumbentTest, AnotherFollowsAtOnceOneThatLeftOrWasSilentForLong) {
  incumbent_.leave();
  EXPECT_EQ(hear(kLater), Heard::kSuccessor);
  EXPECT_EQ(hear(kFirst), Heard::kOther);
  EXPECT_EQ(hear(kEarlier, kSilence), Heard::kSuccessor);
}

}  // namespace
}  // namespace citylearn
