// SPDX-License-Identifier: Apache-2.0
// Which of two learners an env_service works for, and what it says about it: to the one that lost it, to the one that
// asks in vain, and in its log. The learners are scripts, which are silent for as long as a test wants.
#include <gtest/gtest.h>

#include "tests/support/env/env.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class InCharge : public ::testing::Test {
 protected:
  void train(ScriptedPolicy& policy, std::uint32_t frames) {
    policy.walker = &blind_;
    policy.command(settings(msg::TRAIN, frames, 64));
  }
  /// Lets time pass in which the learners say nothing, not even by heartbeats.
  void silence(milliseconds time) {
    const Clock::time_point end = Clock::now() + time;
    witness_.until([&] { return Clock::now() >= end; }, 2 * time);
  }
  /// Lets the policy think: its heartbeats go on, its actions do not.
  static void think(ScriptedPolicy& policy, milliseconds time) {
    Walker* const walker = std::exchange(policy.walker, nullptr);
    const Clock::time_point end = Clock::now() + time;
    policy.until([&] { return Clock::now() >= end; }, 2 * time);
    policy.walker = walker;
  }
  bool both(const std::function<bool()>& condition, milliseconds patience = kShortWait) {
    return eventually([&] { one_.spin(), two_.spin(); }, condition, patience);
  }
  bool steps(ScriptedPolicy& policy) {
    const std::uint64_t before = policy.steps();
    return policy.until([&] { return policy.steps() > before; }, kShortWait);
  }

  Trial trial_{"simulated"};
  Witness witness_{"simulated", trial_.domain()};
  const std::unique_ptr<Service> env_ = trial_.env("summer");
  ScriptedPolicy one_{trial_.middleware(), "default", "env-summer", "one"};
  ScriptedPolicy two_{trial_.middleware(), "default", "env-summer", "two"};
  BlindSweep blind_{64};
};

TEST_F(InCharge, TheOneThatWasSilentIsToldWhoTookOver) {
  train(one_, 32);
  ASSERT_TRUE(one_.until([&] { return one_.steps() > 5; }, kShortWait)) << env_->output();
  EXPECT_TRUE(contains(env_->output(), "settings 1 of 'one': training, frames 0..31")) << env_->output();
  silence(seconds(4));
  train(two_, 16);
  ASSERT_TRUE(two_.until([&] { return two_.steps() > 5; }, kShortWait)) << env_->output();
  EXPECT_EQ(occurrences(env_->output(), "policy_service 'two' takes over from 'one', which was last heard 4."), 1)
      << env_->output();
  EXPECT_TRUE(contains(env_->output(), "settings 1 of 'two': training, frames 0..15")) << env_->output();
  // It goes on with its next action.
  const msg::SettingsId taken = two_.commanded().settings();
  one_.answer(std::vector<std::uint8_t>(8, kStay));
  ASSERT_TRUE(both([&] { return same(one_.info.settings(), taken); })) << "its TraversalInfo shows it";
  ASSERT_TRUE(both([&] { return contains(env_->output(), "rejected an action"); })) << env_->output();
  EXPECT_TRUE(contains(env_->output(),
                       "an action of a service that is not in charge from 'one': 'two' is in charge (more of the kind"))
      << env_->output();
  // Its old settings are not taken, new ones only once the other one is gone.
  const int infos = one_.infos;
  msg::TaskSettings old = one_.commanded();
  ASSERT_TRUE(both([&] { return one_.node.publish(old), one_.infos > infos; })) << "and what it repeats is answered";
  one_.command(settings(msg::TRAIN, 32, 64));
  EXPECT_FALSE(both([&] { return one_.in_force(); }, seconds(6)));
  two_.command(msg::TaskSettings());  // idle
  EXPECT_TRUE(both([&] { return one_.in_force(); })) << env_->output();
  EXPECT_EQ(occurrences(env_->output(), "takes over"), 1) << "what was given up is not taken\n" << env_->output();
}

TEST_F(InCharge, ARestartedOneIsNamedToo) {
  train(one_, 32);
  ASSERT_TRUE(steps(one_)) << env_->output();
  silence(milliseconds(100));  // another moment, another incarnation
  ScriptedPolicy again(trial_.middleware(), "default", "env-summer", "one");
  train(again, 16);
  ASSERT_TRUE(steps(again)) << env_->output();
  EXPECT_TRUE(contains(env_->output(), "policy_service 'one' takes over from its earlier process")) << env_->output();
}

TEST_F(InCharge, ARefusedOneHearsWhoseSettingsAreInForceAsLongAsItAsks) {
  train(one_, 32);
  ASSERT_TRUE(one_.until([&] { return one_.steps() > 5; }, kShortWait)) << env_->output();
  const int known = one_.infos;
  train(two_, 16);
  ASSERT_TRUE(both([&] { return one_.infos >= known + 5; })) << "answered " << one_.infos - known << " times";
  EXPECT_TRUE(same(two_.info.settings(), one_.commanded().settings()));
  EXPECT_FALSE(two_.in_force());
  EXPECT_TRUE(contains(env_->output(), "settings while another policy_service is in charge from 'two': 'one' is"))
      << env_->output();
  // At most one answer a second: ten times as many settings come.
  const int before = one_.infos;
  const Clock::time_point end = Clock::now() + seconds(5);
  both([&] { return Clock::now() >= end; });
  EXPECT_LE(one_.infos - before, 6);
}

TEST_F(InCharge, OneThatThinksIsNotCalledSilent) {
  train(one_, 32);
  for (int step = 0; step < 4; ++step) {
    ASSERT_TRUE(steps(one_)) << env_->output();
    think(one_, seconds(5));
    EXPECT_EQ(one_.status.service_state(), msg::WAITING) << "it says so in its status";
  }
  EXPECT_FALSE(contains(env_->output(), "answers again")) << env_->output();
  EXPECT_FALSE(contains(env_->output(), "waiting for it")) << env_->output();
  // Nor does it ever lose the env_service to one that asks all the time.
  one_.walker = nullptr;
  train(two_, 16);
  EXPECT_FALSE(both([&] { return two_.in_force(); }, seconds(60)));
  EXPECT_FALSE(contains(env_->output(), "takes over")) << env_->output();
}

TEST_F(InCharge, OneThatIsSilentAtEachStepIsNamedOnce) {
  train(one_, 32);
  for (int step = 0; step < 4; ++step) {
    ASSERT_TRUE(steps(one_)) << env_->output();
    silence(seconds(5));
  }
  EXPECT_EQ(occurrences(env_->output(), "nothing of policy_service 'one' for 3 s: waiting for it"), 1)
      << env_->output();
  EXPECT_EQ(occurrences(env_->output(), "policy_service 'one' answers again"), 1) << env_->output();
  // Under new settings once more.
  one_.command(settings(msg::TRAIN, 16, 64));
  ASSERT_TRUE(steps(one_)) << env_->output();
  silence(seconds(5));
  EXPECT_EQ(occurrences(env_->output(), "waiting for it"), 2) << env_->output();
}

}  // namespace
}  // namespace citylearn::testing
