// SPDX-License-Identifier: Apache-2.0
// A second policy_service in a session: it takes no env_service from the first, and what it takes of one that was
// asleep is taken back.
#include <gtest/gtest.h>

#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class SecondPolicy : public ::testing::Test {
 protected:
  SecondPolicy() : witness_("simulated", trial_.domain()) {
    policy_ = trial_.policy({"--agent", "place_filter", "--steps", "100000000"});
  }
  bool trains() {
    const std::uint64_t updates = witness_.updates;
    return witness_.until([&] { return witness_.updates > updates + 3; }, kLong);
  }
  std::unique_ptr<Service> evaluate(const Arguments& more) {
    Arguments all = {"--id",  "second",     "--mode", "evaluate", "--agent",
                     "blind", "--evaluate", "summer", "--tasks",  "16"};
    all.insert(all.end(), more.begin(), more.end());
    return trial_.policy(all);
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

TEST_F(SecondPolicy, WaitsUntilTheFirstHasEnded) {
  ASSERT_TRUE(trains()) << policy_->output();
  const auto second = evaluate({});
  ASSERT_TRUE(second->says("works for 'policy'", seconds(20))) << second->output();
  EXPECT_EQ(policy_->end(SIGTERM, seconds(5)), 130);
  EXPECT_EQ(second->wait(seconds(20)), 0) << second->output();
}

TEST_F(SecondPolicy, TheFirstTakesBackWhatItLostWhileItSlept) {
  ASSERT_TRUE(trains()) << policy_->output();
  policy_->send(SIGSTOP);
  const auto second = evaluate({"--tasks", "1000000"});
  ASSERT_TRUE(witness_.until([&] { return witness_.status["second"].service_state() == msg::RUNNING; }, seconds(30)))
      << second->output();
  const std::uint64_t episodes = witness_.episodes("env-summer");
  ASSERT_TRUE(witness_.until([&] { return witness_.episodes("env-summer") > episodes; }, seconds(30)));
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
