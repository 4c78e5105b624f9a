// SPDX-License-Identifier: Apache-2.0
// A learner and its actors.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>

#include "core/wire/node.h"
#include "tests/support/processes/learning.h"
#include "tests/support/records/witness.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Hears what actors say of themselves.
class Listener {
 public:
  explicit Listener(const Trial& trial) : node_({trial.middleware(), "listener", "listener", "default"}) {
    node_.create_reader<msg::ActorStatus>();
    node_.create_reader<msg::ServiceStatus>();
  }
  /// Until `condition` holds for a status of that actor.
  bool hears(const std::string& actor, const std::function<bool(const msg::ActorStatus&)>& condition,
             milliseconds patience = kWholeRun) {
    const auto heard = [&] {
      while (node_.take(service_)) activities_[service_.header().sender().c_str()] = service_.activity().c_str();
      while (node_.take(status_))
        if (status_.header().sender() == actor && condition(status_)) return true;
      return false;
    };
    return eventually([this] { node_.wait(Clock::now() + milliseconds(50)); }, heard, patience);
  }
  std::string activity(const std::string& id) { return activities_[id]; }

 private:
  Node node_;
  msg::ActorStatus status_;
  msg::ServiceStatus service_;
  std::map<std::string, std::string> activities_;
};

TEST(Roles, OthersTakeOverFromAKilledActorAndShareWithItWhenItIsBack) {
  Learning run("simulated");
  const auto one = run.trial.env("summer", {"--id", "one"}), two = run.trial.env("summer", {"--id", "two"});
  const auto learner = run.learner(100000, {"--environments", "2"});
  Listener listener(run.trial);
  const auto a = run.actor("a");
  auto b = run.actor("b");
  const auto serves = [&](const char* actor, std::size_t count) {
    return listener.hears(actor, [&](const auto& status) { return status.environments().size() == count; });
  };
  ASSERT_TRUE(serves("a", 1)) << a->output();
  ASSERT_TRUE(serves("b", 1)) << b->output();
  ASSERT_TRUE(run.reaches(3)) << learner->output();
  ASSERT_TRUE(b->end(SIGKILL, seconds(5)).has_value());
  EXPECT_TRUE(serves("a", 2)) << a->output();
  EXPECT_TRUE(learner->says("actor 'b' went silent", kWholeRun)) << learner->output();
  ASSERT_TRUE(run.reaches(run.updates() + 3)) << learner->output();
  b = run.actor("b");
  EXPECT_TRUE(serves("b", 1)) << b->output();
  EXPECT_TRUE(serves("a", 1)) << a->output();
  EXPECT_TRUE(learner->says("actor 'b' is back", seconds(5))) << learner->output();
  ASSERT_TRUE(run.reaches(run.updates() + 3)) << learner->output();
  EXPECT_EQ(a->end(SIGTERM, seconds(5)), 130);
  EXPECT_TRUE(serves("b", 2)) << "who leaves says so";
  EXPECT_EQ(learner->end(SIGTERM, seconds(5)), 130);
  run.expect_whole_records();
}

TEST(Roles, ALateActorGetsTheNewestParametersAtOnce) {
  Learning run("simulated");
  const auto one = run.trial.env("summer", {"--id", "one"});
  const auto learner = run.learner(100000);
  const auto a = run.actor("a");
  ASSERT_TRUE(run.reaches(5)) << learner->output();
  Listener listener(run.trial);
  // Nothing new comes while nobody acts: what the late one gets is what it asks for.
  ASSERT_TRUE(a->end(SIGKILL, seconds(5)).has_value());
  const int version = run.updates();
  const auto b = run.actor("b");
  std::uint64_t first = 0;
  ASSERT_TRUE(listener.hears("b", [&](const auto& status) {
    first = status.version();
    return status.environments().size() == 1;
  })) << b->output();
  EXPECT_GE(first, static_cast<std::uint64_t>(version)) << "it has acted with older ones";
  EXPECT_TRUE(run.reaches(version + 3)) << learner->output();
}

TEST(Roles, ActorsWaitForALearnerThatIsSlow) {
  Learning run("simulated");
  const auto summer = run.trial.env("summer");
  const auto learner = run.learner(100000, {"--window", "3"});
  const auto actor = run.actor("a");
  ASSERT_TRUE(run.reaches(2)) << learner->output();
  Listener listener(run.trial);
  learner->send(SIGSTOP);
  std::uint32_t kept = 0;
  double waited = 0;
  ASSERT_TRUE(listener.hears("a", [&](const auto& status) {
    kept = status.unacknowledged();
    waited = status.waited();
    return status.waiting() && kept > 0;
  })) << actor->output();
  EXPECT_GT(kept, 2u * 8u) << "a part of the first may be taken";
  EXPECT_LE(kept, 3u * 8u) << "three segments of eight agents";
  // It stays so: a second of waiting is counted, nothing is added.
  ASSERT_TRUE(listener.hears("a", [&](const auto& status) {
    EXPECT_EQ(status.unacknowledged(), kept);
    const std::string wanted = "waiting for learner 'policy' to take " + std::to_string(kept);
    return status.waited() > waited + 1 && listener.activity("a").find(wanted) != std::string::npos;
  })) << listener.activity("a");
  const int before = run.updates();
  learner->send(SIGCONT);
  EXPECT_TRUE(run.reaches(before + 5)) << learner->output();
  EXPECT_TRUE(listener.hears("a", [](const auto& status) { return !status.waiting(); }));
}

TEST(Actor, FollowsTheLessonsAndStaysForTheNextLearner) {
  Learning run("simulated");
  const auto summer = run.trial.env("summer");
  const auto actor = run.actor("a", {"--stay"});
  auto learner = run.learner(100000, {"--curriculum"});
  const auto lesson = [&] {
    const auto rows = run.metrics();
    return rows.empty() || rows.back().size() < 4 ? 0 : std::stoi(rows.back()[3]);
  };
  ASSERT_TRUE(poll_until([&] { return lesson() >= 2; }, kWholeRun)) << learner->output() << actor->output();
  EXPECT_EQ(learner->end(SIGTERM, seconds(5)), 130);
  const auto afresh = [&] {  // a run that is not to be overwritten stands in the way of the next
    std::filesystem::remove_all(run.trial.folder() / "out");
    learner = run.learner(3);
  };
  afresh();
  EXPECT_EQ(learner->wait(kWholeRun), 0) << learner->output();
  ASSERT_TRUE(actor->says("has ended", seconds(10))) << actor->output();
  afresh();
  EXPECT_EQ(learner->wait(kWholeRun), 0) << learner->output();
  EXPECT_FALSE(actor->wait(milliseconds(1)).has_value()) << "it stays";
  EXPECT_EQ(actor->end(SIGTERM, seconds(5)), 130);
}

TEST(Actor, ALateOrderToServeDoesNotUndoARelease) {
  Trial trial("simulated");
  Witness witness("simulated", trial.domain());
  Node learner({trial.middleware(), "policy_service", "learner", "default"});
  const auto actor = trial.policy({"--role", "actor", "--id", "actor"});
  msg::LearnerInfo info;
  info.training() = true;
  info.frames() = info.lesson_frames() = 2;
  info.steps() = info.window() = 1;
  ASSERT_TRUE(witness.until([&] { return witness.incarnation("actor") != 0; }, kShortWait)) << actor->output();
  learner.publish(info);
  ASSERT_TRUE(actor->says("learner 'learner'", kShortWait)) << actor->output();
  msg::Assignment order;
  order.actor() = "actor";
  order.actor_incarnation() = witness.incarnation("actor");
  const auto give = [&](const char* env, bool serve) {
    order.environment() = env;
    order.serve() = serve;
    learner.publish(order);
    return actor->says((serve ? "assigns env_service '" : "releases env_service '") + std::string(env), kShortWait);
  };
  ASSERT_TRUE(give("summer", true)) << actor->output();
  const msg::Assignment late = order;
  ASSERT_TRUE(give("summer", false)) << actor->output();
  learner.forward(late);
  ASSERT_TRUE(give("winter", true)) << "each env_service has an order of its own\n" << actor->output();
  EXPECT_EQ(occurrences(actor->output(), "assigns env_service 'summer'"), 1) << actor->output();
}

TEST(Roles, ALearnerSaysWhenItsUpdatesAreTooSmallForItsActors) {
  Learning run("simulated");
  const auto summer = run.trial.env("summer", {"--agents", "256"});
  const auto learner = run.trial.policy(
      {"--role", "learner", "--steps", "10000000", "--trainer-agents", "4", "--tasks", "10", "--evaluate", "summer"});
  const auto actor = run.actor("a");
  EXPECT_TRUE(learner->says("of an update. Raise --trainer-agents", kWholeRun)) << learner->output();
  EXPECT_EQ(learner->end(SIGTERM, seconds(5)), 130);
}

TEST(Roles, AnActorWithoutAnEnvServiceSaysWhatToDo) {
  Learning run("simulated");
  const auto one = run.trial.env("summer", {"--id", "one"});
  const auto learner = run.learner(100000);
  const auto first = run.actor("first");
  ASSERT_TRUE(run.reaches(2)) << learner->output();
  const auto second = run.actor("second");
  EXPECT_TRUE(
      second->says("waiting for an env_service from learner 'policy'; start more if all are taken", seconds(20)))
      << second->output();
  const auto two = run.trial.env("summer", {"--id", "two"});
  EXPECT_TRUE(second->says("assigns env_service", seconds(20))) << second->output();
}

TEST(TwoLearners, TheSecondSaysWhomTheActorsWorkForAndGetsThemAfterwards) {
  Learning run("simulated");
  const auto summer = run.trial.env("summer");
  const auto actor = run.actor("a", {"--stay"});
  const auto first = run.learner(100000, {"--id", "first"});
  ASSERT_TRUE(run.reaches(2)) << first->output() << actor->output();
  const auto second = run.trial.policy({"--role", "learner", "--id", "second", "--steps", "1024", "--trainer-agents",
                                        "8", "--tasks", "10", "--evaluate", "summer"});
  ASSERT_TRUE(second->says("actors: all work for learner 'first'", seconds(20))) << second->output();
  EXPECT_FALSE(contains(second->output(), "actor 'a' joins"));
  const int updates = run.updates();
  EXPECT_TRUE(run.reaches(updates + 3)) << "the first one is not disturbed";
  EXPECT_EQ(first->end(SIGTERM, seconds(5)), 130);
  EXPECT_EQ(second->wait(kWholeRun), 0) << second->output() << actor->output();
}

}  // namespace
}  // namespace citylearn::testing
