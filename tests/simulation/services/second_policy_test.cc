// SPDX-License-Identifier: Apache-2.0
// A second policy_service in a session: it takes no env_service from the first, and what it takes of one that was
// asleep is taken back.
#include <gtest/gtest.h>

#include "core/exchange/timing.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class SecondPolicy : public ::testing::Test {
 protected:
  SecondPolicy() : witness_("simulated", trial_.domain()) {
    // One that begins anew at no checkpoint: it gives settings once.
    policy_ = trial_.policy({"--agent", "place_filter", "--steps", "100000000", "--checkpoint-every", "1000000"});
  }
  bool trains() {
    const std::uint64_t updates = witness_.updates;
    return witness_.until([&] { return witness_.updates > updates + 3; }, kLongWait);
  }
  std::unique_ptr<Service> evaluate(const Arguments& more) {
    return trial_.policy(Arguments{"--id", "second", "--mode", "evaluate", "--agent", "blind"} +
                         Arguments{"--evaluate", "summer", "--tasks", "16"} + more);
  }

  Trial trial_{"simulated"};
  Witness witness_;
  std::unique_ptr<Service> env_ = trial_.env("summer"), policy_;
};

TEST_F(SecondPolicy, NamesWhoUsesTheEnvServiceAndLeavesItAlone) {
  ASSERT_TRUE(trains()) << policy_->output();
  const auto second = evaluate({"--wait", "5"});
  EXPECT_EQ(second->wait(seconds(20)), 1) << second->output();
  EXPECT_TRUE(contains(second->output(), "works for")) << second->output();
  EXPECT_TRUE(contains(second->output(), "'policy'")) << second->output();
  EXPECT_TRUE(trains()) << "undisturbed";
  EXPECT_EQ(witness_.alarm("policy"), "");
}

// The twin ends by itself. Until then the env_service that was there first does not miss a step.
TEST_F(SecondPolicy, ASecondEnvServiceOfOneIdDisturbsNobody) {
  ASSERT_TRUE(trains()) << policy_->output();
  const auto twin = trial_.env("summer");
  std::uint64_t updates = witness_.updates;
  Clock::time_point last = Clock::now();
  milliseconds longest{0};
  const auto ended = [&] {
    if (witness_.updates != updates) {
      updates = witness_.updates;
      longest = std::max(longest, std::chrono::duration_cast<milliseconds>(Clock::now() - last));
      last = Clock::now();
    }
    return twin->wait(milliseconds(1)).has_value();
  };
  ASSERT_TRUE(witness_.until(ended, seconds(20))) << twin->output();
  EXPECT_EQ(twin->wait(milliseconds(0)), 1);
  EXPECT_TRUE(contains(twin->output(), "id 'env-summer': already runs in session 'default'")) << twin->output();
  EXPECT_LT(longest, milliseconds(500)) << policy_->output();
  EXPECT_TRUE(trains()) << policy_->output();
  EXPECT_FALSE(contains(policy_->output(), "silent")) << policy_->output();
}

TEST_F(SecondPolicy, WaitsUntilTheFirstHasEnded) {
  ASSERT_TRUE(trains()) << policy_->output();
  const auto second = evaluate({});
  ASSERT_TRUE(second->says("works for 'policy'", seconds(20))) << second->output();
  EXPECT_EQ(policy_->end(SIGTERM, seconds(5)), 130);
  EXPECT_EQ(second->wait(seconds(20)), 0) << second->output();
}

TEST_F(SecondPolicy, TheFirstTakesBackWhatItLostWhileItSlept) {
  ASSERT_TRUE(trains()) << policy_->output();
  // Longer than settings may remain unconfirmed: they were confirmed long ago.
  const Clock::time_point end = Clock::now() + kCommandGiveUp;
  ASSERT_TRUE(witness_.until([&] { return Clock::now() > end; }, 2 * kCommandGiveUp)) << policy_->output();
  policy_->send(SIGSTOP);
  const auto second = evaluate({"--tasks", "1000000"});
  ASSERT_TRUE(env_->says("policy_service 'second' takes over from 'policy'", seconds(30)))
      << env_->output() << second->output();
  policy_->send(SIGCONT);
  EXPECT_TRUE(witness_.until([&] { return contains(witness_.alarm("policy"), "works for 'second'"); }, seconds(10)))
      << witness_.alarm("policy");
  EXPECT_EQ(second->end(SIGTERM, seconds(5)), 130);
  EXPECT_TRUE(trains()) << policy_->output();
  EXPECT_TRUE(witness_.until([&] { return witness_.alarm("policy").empty(); }, seconds(10)))
      << witness_.alarm("policy");
}

}  // namespace
}  // namespace citylearn::testing
