// SPDX-License-Identifier: Apache-2.0
// When commands go out, and which of them a target obeys.
#include "core/exchange/command.h"

#include <gtest/gtest.h>

#include <vector>

namespace citylearn::testing {
namespace {

using Verdict = CommandTarget::Verdict;
const Clock::time_point kStart = Clock::now();

TEST(CommandSender, SendsAtOnceThenLessAndLessOftenUntilConfirmed) {
  CommandSender sender;
  EXPECT_FALSE(sender.unconfirmed());
  EXPECT_FALSE(sender.take_due(kStart)) << "nothing was commanded";
  sender.begin(kStart);
  std::vector<Clock::duration> intervals;
  for (Clock::time_point last = kStart; intervals.size() < 8; last = sender.due()) {
    EXPECT_FALSE(sender.take_due(sender.due() - 1ms));
    EXPECT_TRUE(sender.take_due(sender.due()));
    intervals.push_back(sender.due() - last);
  }
  EXPECT_EQ(intervals, (std::vector<Clock::duration>{50ms, 100ms, 200ms, 400ms, 800ms, 1s, 1s, 1s}));
  sender.confirm();
  EXPECT_FALSE(sender.take_due(kStart + 1h));
  EXPECT_EQ(sender.unconfirmed_for(kStart + 1h), Clock::duration());
  sender.begin(kStart + 1h);
  EXPECT_TRUE(sender.take_due(kStart + 1h));
  EXPECT_EQ(sender.due(), kStart + 1h + kCommandResend) << "anew";
}

TEST(CommandSender, TimeInWhichTheTargetCannotObeyDoesNotCount) {
  CommandSender sender;
  sender.begin(kStart);
  EXPECT_TRUE(sender.take_due(kStart));
  EXPECT_EQ(sender.unconfirmed_for(kStart + 5s), 5s);
  sender.hold(kStart + 5s);
  EXPECT_EQ(sender.unconfirmed_for(kStart + 7s), 2s);
  EXPECT_EQ(sender.due(), kStart + kCommandResend) << "it is told all the same";
}

TEST(CommandTarget, ObeysEachVersionOnceAndNoOlderOne) {
  CommandTarget target;
  EXPECT_EQ(target.take(1, 3, kStart), Verdict::kNew);
  EXPECT_EQ(target.take(1, 3, kStart), Verdict::kNew) << "it is not obeyed yet";
  target.obey(3, true);
  EXPECT_EQ(target.take(1, 3, kStart), Verdict::kOld);
  EXPECT_EQ(target.take(1, 2, kStart), Verdict::kOld);
  EXPECT_EQ(target.take(1, 4 + kMaxVersionsAhead, kStart), Verdict::kTooFarAhead);
  EXPECT_EQ(target.take(1, 4, kStart), Verdict::kNew);
  target.obey(4, false);
  EXPECT_EQ(target.take(2, 1, kStart), Verdict::kNew) << "of another commander";
  target.obey(1, false);
  EXPECT_EQ(target.take(1, 4, kStart), Verdict::kOld) << "however many came between";
}

TEST(CommandTarget, KeepsToTheCommanderThatGaveItWork) {
  CommandTarget target;
  EXPECT_FALSE(target.in_charge());
  EXPECT_EQ(target.take(1, 1, kStart), Verdict::kNew);
  target.obey(1, true);
  EXPECT_TRUE(target.in_charge(1));
  // While it is heard, for ever.
  for (Clock::time_point now = kStart; now < kStart + 60s; now += 1s) {
    target.hear(1, now);
    EXPECT_EQ(target.take(2, 1, now), Verdict::kNotInCharge);
  }
  // Until it releases the target.
  EXPECT_EQ(target.take(1, 2, kStart + 60s), Verdict::kNew);
  target.obey(2, false);
  EXPECT_FALSE(target.in_charge());
  EXPECT_EQ(target.take(2, 1, kStart + 60s), Verdict::kNew);
  target.obey(1, true);
  EXPECT_FALSE(target.replaced(1)) << "it gave it up";
  // Or leaves.
  target.hear(2, kStart + 61s, /*leaves=*/true);
  EXPECT_EQ(target.take(1, 3, kStart + 61s), Verdict::kNew);
  target.obey(3, true);
  EXPECT_TRUE(target.replaced(2));
  // Or is silent.
  EXPECT_EQ(target.take(3, 1, kStart + 62s), Verdict::kNotInCharge);
  EXPECT_TRUE(target.silent(kStart + 61s + kSilence));
  EXPECT_EQ(target.take(3, 1, kStart + 61s + kSilence), Verdict::kNew);
  target.obey(1, true);
  EXPECT_TRUE(target.replaced(1));
  EXPECT_FALSE(target.replaced(2));
}

TEST(CommandTarget, OneThatIsIdleAndWorksAgainStaysInCharge) {
  CommandTarget target;
  std::uint32_t version = 0;
  for (const bool works : {true, false, true}) {
    EXPECT_EQ(target.take(1, ++version, kStart), Verdict::kNew);
    target.obey(version, works);
  }
  EXPECT_EQ(target.take(2, 1, kStart + 1s), Verdict::kNotInCharge);
}

}  // namespace
}  // namespace citylearn::testing
