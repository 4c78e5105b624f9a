// SPDX-License-Identifier: Apache-2.0
// One env_service and a scripted policy: over each vendor, and in simulation, also over a transport that loses, repeats
// and reorders. Whatever happens on the way, the episodes are those of an Environment walked
// by hand.
#include "tests/support/env/env_protocol.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "core/exchange/incumbent.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

TEST_P(EnvProtocol, ByReferenceObservationsNameTheirFramesAndNothingElseChanges) {
  const std::uint32_t count = 16;
  msg::TaskSettings by_reference = tasks(count);
  by_reference.by_reference() = true;
  policy_->command(by_reference);
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 5; }));
  EXPECT_TRUE(policy_->seen.by_reference());
  EXPECT_EQ(policy_->seen.feature_dimension(), 0u);
  EXPECT_TRUE(policy_->seen.features().empty());
  EXPECT_EQ(policy_->seen.frame().size(), std::size_t{kAgents});
  expect_evaluation(count);
  ASSERT_TRUE(policy_->until([&] { return policy_->info.by_reference(); })) << "and so does its TraversalInfo";
  EXPECT_EQ(policy_->info.feature_dimension(), 64u);
  // A policy_service that asks for nothing gets features.
  policy_->command(tasks(count));
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force() && policy_->steps() > 5; }));
  EXPECT_FALSE(policy_->seen.by_reference());
  EXPECT_EQ(policy_->seen.features().size(), std::size_t{kAgents} * 64);
}

TEST_P(EnvProtocol, WholeEvaluation) {
  const std::uint32_t count = GetParam().lossy ? 20 : 100;  // each loss costs 50 ms
  policy_->command(tasks(count));
  expect_evaluation(count);
}

TEST_P(EnvProtocol, LostActionsOnlyCostTime) {
  policy_->ignore_every = 7;
  policy_->command(tasks(16));
  expect_evaluation(16);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.resent() > 5; }));
}

TEST_P(EnvProtocol, RepeatedActionsChangeNothing) {
  policy_->copies = 3;
  policy_->command(tasks(24));
  expect_evaluation(24);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.repeated() > 50; }));
}

TEST_P(EnvProtocol, ActionsOfOtherSettingsStepsAndIncarnationsChangeNothing) {
  policy_->command(tasks(16));
  const std::function<void(msg::Action&)> changes[] = {
      [](msg::Action& a) { a.step() += 1; }, [](msg::Action& a) { a.settings().version() += 1; },
      [](msg::Action& a) { a.environment_incarnation() += 1; }, [](msg::Action& a) { a.environment() = "env-winter"; }};
  std::size_t count = 0;
  policy_->spoil = [&](msg::Action& action) {
    // A wrong one first; the right one follows when the observation comes again.
    msg::Action wrong = action;
    changes[count++ % std::size(changes)](wrong);
    policy_->node.publish(wrong);
  };
  expect_evaluation(16);
}

TEST_P(EnvProtocol, MaskedActionsAreRejectedAndTheGoodOneStillCounts) {
  policy_->command(tasks(8));
  int spoiled = 0;
  policy_->spoil = [&](msg::Action& action) {
    if (action.step() % 10 != 0) return;
    msg::Action bad = action;
    switch (++spoiled % 3) {
      case 0:
        bad.choice().pop_back();
        break;
      case 1:
        bad.choice().push_back(kStay);
        break;
      case 2:
        for (std::size_t agent = 0; agent < bad.choice().size(); ++agent) {
          const std::uint8_t allowed = policy_->seen.allowed()[agent];
          if (!(allowed >> kPrevious & 1)) bad.choice()[agent] = kPrevious;
          if (!(allowed >> kNext & 1)) bad.choice()[agent] = kNext;
        }
        break;
    }
    if (bad.choice() != action.choice()) policy_->node.publish(bad);
  };
  expect_evaluation(8);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.rejected() > 0; }));
}

TEST_P(EnvProtocol, TrainingGoesOnForEver) {
  policy_->command(settings(msg::TRAIN, 32, 64));
  const std::uint64_t enough = GetParam().lossy ? 20 : 100;
  ASSERT_TRUE(policy_->until([&] { return policy_->recorded >= enough; }));
  for (const auto& [number, stat] : policy_->episodes) {
    EXPECT_FALSE(stat.evaluation());
    EXPECT_LT(stat.start(), 32u);
    EXPECT_LT(stat.goal(), 32u);
  }
  ASSERT_TRUE(
      policy_->until([&] { return policy_->status.service_state() == msg::RUNNING && policy_->status.rate() > 0; }));
}

TEST_P(EnvProtocol, RestartedPolicyTakesOverMidEpisode) {
  ASSERT_TRUE(trains(64, 30));
  const std::uint64_t last = policy_->recorded;
  const msg::Observation old = policy_->seen;
  policy_.reset();
  policy_ = new_policy();
  policy_->command(tasks(24));
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force() && policy_->steps() > 10; })) << "its settings win";
  // What its predecessor had on the way comes late.
  msg::TaskSettings stale = settings(msg::TRAIN, 64, 64);
  stale.environment() = "env-summer";
  stale.settings() = old.settings();
  stale.settings().version() = 99;
  policy_->node.publish(stale);
  const auto evaluated = [&] {
    std::size_t count = 0;
    for (const auto& [number, stat] : policy_->episodes)
      count += same(stat.settings(), policy_->commanded().settings());
    return count;
  };
  // It does not know the episodes its predecessor acknowledged; the first it hears says how far that went.
  policy_->acknowledge = false;
  ASSERT_TRUE(policy_->until([&] { return evaluated() == 24; }));
  EXPECT_GT(policy_->episodes.rbegin()->first, last);
  const std::uint64_t from = policy_->episodes.begin()->first;
  EXPECT_EQ(policy_->episodes.rbegin()->first - from + 1, policy_->episodes.size()) << "no gap";
  policy_->send_acknowledgement(policy_->episodes.rbegin()->first);
}

// A policy_service that was restarted after its host's clock had been set back.
TEST_P(EnvProtocol, APolicyWhoseClockWasSetBackTakesOver) {
  ASSERT_TRUE(trains(32, 20));
  msg::TaskSettings earlier = settings(msg::TRAIN, 16, 64);
  earlier.environment() = "env-summer";
  earlier.header() = policy_->commanded().header();
  earlier.header().incarnation() -= 3'600'000'000;  // microseconds
  earlier.settings().incarnation() = earlier.header().incarnation();
  earlier.settings().version() = 1;
  policy_.reset();
  policy_ = new_policy();
  EXPECT_TRUE(eventually(
      [&] {
        policy_->node.forward(earlier);
        policy_->spin();
      },
      [&] { return same(policy_->info.settings(), earlier.settings()); }, kMaxWait));
}

TEST_P(EnvProtocol, OlderSettingsAreIgnoredAndRepeatedOnesConfirmedAgain) {
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force(); }));
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force(); }));
  EXPECT_EQ(policy_->info.settings().version(), 2u);
  msg::TaskSettings old = policy_->commanded();
  old.settings().version() = 1;
  old.task_mode() = msg::TRAIN;
  old.frames() = 10;
  old.max_steps() = 10;
  policy_->node.publish(old);
  msg::TaskSettings again = policy_->commanded();
  const int before = policy_->infos;
  policy_->node.publish(again);
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > before; }));
  EXPECT_EQ(policy_->info.settings().version(), 2u);
  EXPECT_EQ(policy_->observations, 0);
}

TEST_P(EnvProtocol, IdleIsConfirmedAndSilent) {
  ASSERT_TRUE(trains(32, 5));
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force(); }));
  EXPECT_EQ(policy_->info.settings().version(), 2u);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.service_state() == msg::WAITING; }));
  // The last observation may arrive after the status, because they have topics of their own.
  const int first = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > first; })) << "who comes next must find it";
  const int before = policy_->observations, infos = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos >= infos + 2; }));
  EXPECT_EQ(policy_->observations, before);
}

TEST_P(EnvProtocol, RefusedSettingsAreToldAndNotInForce) {
  ASSERT_TRUE(trains(32, 5));
  policy_->command(settings(msg::TRAIN, 201, 64));
  ASSERT_TRUE(policy_->until([&] { return policy_->status.service_state() == msg::FAILED; }));
  EXPECT_TRUE(contains(policy_->status.activity().c_str(), "TaskSettings.frames: the route ends at frame 201"))
      << policy_->status.activity();
  ASSERT_TRUE(policy_->until([&] { return policy_->info.settings().version() == 0; }));
  EXPECT_FALSE(policy_->in_force());
  policy_->command(tasks(8));
  ASSERT_TRUE(policy_->until([&] { return policy_->status.service_state() != msg::FAILED && policy_->steps() > 5; }));
}

TEST_P(EnvProtocol, EpisodesAreRepeatedUntilAcknowledgedAndThenNoMore) {
  // No more than are repeated at once, or those lost after the first 64 would wait for an acknowledgement.
  const std::uint32_t count = GetParam().lossy ? 16 : 60, part = count * 2 / 3;
  policy_->acknowledge = false;
  policy_->command(tasks(count));
  ASSERT_TRUE(policy_->until([&] { return policy_->recorded == count; }));
  const int before = policy_->episode_messages;
  ASSERT_TRUE(policy_->until([&] { return policy_->episode_messages >= before + static_cast<int>(count); })) << "again";
  // Acknowledged in part: only the rest is repeated, and says so, once what was on its way has come.
  const auto newest = [&](const auto& entry) { return entry.first > part && entry.second.log().first() == part + 1; };
  const auto only_the_rest = [&] {
    return policy_->episodes.size() == count - part &&
           std::all_of(policy_->episodes.begin(), policy_->episodes.end(), newest);
  };
  const Clock::time_point deadline = Clock::now() + kMaxWait;
  while (!only_the_rest() && Clock::now() < deadline) {
    // The first copy that comes is kept: older ones make room for newer ones.
    std::erase_if(policy_->episodes, [&](const auto& entry) { return !newest(entry); });
    policy_->send_acknowledgement(part);
    policy_->until(only_the_rest, milliseconds(500));
  }
  ASSERT_TRUE(only_the_rest());
  // A wrong acknowledgement covers nothing.
  policy_->send_acknowledgement(count + 1);
  policy_->episodes.clear();
  ASSERT_TRUE(policy_->until([&] { return policy_->episodes.size() == count - part; }));
  // All acknowledged: the counter of repetitions stands still over three heartbeats.
  std::uint64_t resent = 0;
  int quiet = 0, statuses = policy_->statuses;
  ASSERT_TRUE(until_asking([&] { policy_->send_acknowledgement(count); },
                           [&] {
                             if (policy_->statuses != statuses) {
                               statuses = policy_->statuses;
                               quiet = policy_->status.resent() == resent ? quiet + 1 : 0;
                               resent = policy_->status.resent();
                             }
                             return quiet >= 3;
                           }));
}

/// The dashboard comes late, dies in the middle and comes back; the policy_service has had everything long before.
TEST_P(EnvProtocol, SilentPolicyIsWaitedFor) {
  policy_->command(tasks(16));
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 10; }));
  policy_->walker = nullptr;
  ASSERT_TRUE(policy_->until([&] { return policy_->status.service_state() == msg::WAITING; }));
  EXPECT_EQ(std::string(policy_->status.activity()), "waiting for the policy_service");
  const int infos = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > infos; })) << "who comes next must find it";
  policy_->walker = &blind_;
  expect_evaluation(16);
}

INSTANTIATE_TEST_SUITE_P(Wires, EnvProtocol, ::testing::ValuesIn(kWires), wire_name);

}  // namespace
}  // namespace citylearn::testing
