// SPDX-License-Identifier: Apache-2.0
#include "core/recording/replay_clock.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::int64_t kTapeSecond = 1'000'000'000;

double seconds_until(Clock::time_point time) { return std::chrono::duration<double>(time - Clock::now()).count(); }

TEST(ReplayClock, GoesAtItsSpeedFromTheFirstMessageOn) {
  ReplayClock clock(4);
  const Clock::time_point first = clock.due(10 * kTapeSecond);
  EXPECT_LE(first, Clock::now()) << "it is due at once";
  EXPECT_NEAR(seconds_until(clock.due(12 * kTapeSecond)), .5, .4);
  const Clock::time_point due = clock.due(12 * kTapeSecond);
  clock.delay(std::chrono::seconds(3));
  EXPECT_EQ(clock.due(12 * kTapeSecond), due + std::chrono::seconds(3)) << "readers were waited for";
}

TEST(ReplayClock, TimeIsThatOfTheRecordingUntilItsEndAndGoesOnThen) {
  ReplayClock clock(0);
  clock.due(0);
  const Clock::time_point begin = clock.now();
  EXPECT_EQ(clock.due(5 * kTapeSecond), Clock::time_point::min()) << "as fast as it can";
  EXPECT_EQ(clock.now() - begin, std::chrono::seconds(5)) << "however fast it is played";
  clock.end(7 * kTapeSecond);
  EXPECT_GE(clock.now() - begin, std::chrono::seconds(7));
  const Clock::time_point end = clock.now();
  EXPECT_TRUE(eventually([] { std::this_thread::yield(); }, [&] { return clock.now() > end; }))
      << "so that services become silent";
}

TEST(ReplayClock, TimeDoesNotPassTheNextMessage) {
  ReplayClock clock(1e6);
  clock.due(0);
  const Clock::time_point begin = clock.now();
  EXPECT_TRUE(eventually([] { std::this_thread::yield(); },
                         [&] {
                           clock.due(kTapeSecond);
                           return clock.now() - begin == std::chrono::seconds(1);
                         }));
}

}  // namespace
}  // namespace citylearn::testing
