// SPDX-License-Identifier: Apache-2.0
#include "tests/simulation/machine/scheduler.h"

#include <gtest/gtest.h>

#include <string>

namespace citylearn::simulation {
namespace {

using std::chrono::seconds;

/// Three tasks that each wait a second three times. Returns who had its turn when.
std::string order_of(std::uint64_t seed) {
  Scheduler scheduler(seed);
  std::string order;
  for (const char name : {'a', 'b', 'c'})
    scheduler.start([&scheduler, &order, name] {
      for (int turn = 1; turn <= 3; ++turn) {
        scheduler.wait_until(seconds(turn));
        order += name;
      }
    });
  EXPECT_TRUE(scheduler.run(seconds(10)));
  EXPECT_LT(scheduler.now(), seconds(4)) << "the clock moves on to the next deadline and no further";
  return order;
}

TEST(Scheduler, TheSeedDecidesTheOrder) {
  bool differs = false;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const std::string order = order_of(seed);
    EXPECT_EQ(order.size(), 9u);
    EXPECT_EQ(order, order_of(seed)) << "seed " << seed;
    differs |= order != order_of(1);
  }
  EXPECT_TRUE(differs);
}

TEST(Scheduler, ATaskWaitsUntilItIsWokenOrTheTimeComes) {
  Scheduler scheduler(1);
  Time woken{}, late{};
  Task& sleeper = scheduler.start([&] {
    scheduler.wait_until(seconds(100));
    woken = scheduler.now();
    scheduler.wait_until(seconds(100));
    late = scheduler.now();
  });
  scheduler.at(seconds(3), [&] { scheduler.wake(sleeper); });
  EXPECT_TRUE(scheduler.run(seconds(1000)));
  EXPECT_EQ(woken / seconds(1), 3);
  EXPECT_EQ(late / seconds(1), 100);
}

TEST(Scheduler, AKilledTaskIsUnwoundAndDoesNothingMore) {
  Scheduler scheduler(1);
  bool unwound = false, went_on = false;
  struct Guard {
    bool& flag;
    ~Guard() { flag = true; }
  };
  Task& victim = scheduler.start([&] {
    const Guard guard{unwound};
    scheduler.wait_until(seconds(100));
    went_on = true;
  });
  scheduler.at(seconds(5), [&] {
    scheduler.kill(victim);
    EXPECT_TRUE(victim.dead());
  });
  EXPECT_TRUE(scheduler.run(seconds(10)));
  EXPECT_TRUE(unwound);
  EXPECT_FALSE(went_on);
}

TEST(Scheduler, AStalledTaskHasItsTurnAfterwards) {
  Scheduler scheduler(1);
  Time turn{};
  Task& task = scheduler.start([&] {
    scheduler.wait_until(seconds(2));
    turn = scheduler.now();
  });
  scheduler.at(seconds(1), [&] { scheduler.stall(task, seconds(7)); });
  EXPECT_TRUE(scheduler.run(seconds(10)));
  EXPECT_EQ(turn / seconds(1), 7);
}

TEST(Scheduler, RunStopsAtItsTimeAndGoesOnLater) {
  Scheduler scheduler(1);
  int turns = 0;
  scheduler.start([&] {
    for (int turn = 1; turn <= 4; ++turn) {
      scheduler.wait_until(seconds(turn));
      ++turns;
    }
  });
  EXPECT_FALSE(scheduler.run(std::chrono::milliseconds(2500)));
  EXPECT_EQ(turns, 2);
  EXPECT_TRUE(scheduler.run(seconds(10)));
  EXPECT_EQ(turns, 4);
}

TEST(Scheduler, ItsEndKillsWhatStillRuns) {
  bool ended = false;
  struct Guard {
    bool& flag;
    ~Guard() { flag = true; }
  };
  {
    Scheduler scheduler(1);
    scheduler.start([&] {
      const Guard guard{ended};
      while (true) scheduler.wait_until(scheduler.now() + seconds(1));
    });
    EXPECT_FALSE(scheduler.run(seconds(3)));
    EXPECT_FALSE(ended);
  }
  EXPECT_TRUE(ended);
}

}  // namespace
}  // namespace citylearn::simulation
