// SPDX-License-Identifier: Apache-2.0
// One env_service and a scripted policy: over each vendor, and in simulation, also over a transport that loses, repeats
// and reorders. Whatever happens on the way, the episodes are those of an Environment walked by hand.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kSummerFrames = 200, kSummerAgents = 8;
constexpr char kLoss[] = "lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=";

struct Wire {
  const char* name;
  const char* middleware;
  std::uint32_t domain;
  bool lossy;
};

#ifdef CITYLEARN_SIMULATED
constexpr Wire kWires[] = {{"simulated", "simulated", 0, false}, {"lossy", "simulated", 0, true}};
#else
constexpr Wire kWires[] = {{"cyclonedds", "cyclonedds", 40, false}, {"fastdds", "fastdds", 41, false}};
#endif
std::string wire_name(const ::testing::TestParamInfo<Wire>& wire) { return wire.param.name; }

Traversal summer() { return make_dataset("synthetic", "", {{"frames", kSummerFrames}, {"images", 0}})->load("summer"); }

/// An env_service on traversal `summer` of a small synthetic city.
class SummerService {
 public:
  SummerService(const Wire& wire, const std::string& run) {
    Arguments command{CITYLEARN_ENV_SERVICE, "--synthetic-images", "0", "--session", run};
    command.insert(command.end(),
                   {"--domain", std::to_string(wire.domain), "--middleware", middleware(wire, 1).name, "--agents",
                    std::to_string(kSummerAgents), "--synthetic-frames", std::to_string(kSummerFrames)});
    service_ = std::make_unique<Service>(command, folder_ / "log");
  }
  ~SummerService() {
    // Recorders of this process may seem to live.
    EXPECT_EQ(service_->end(SIGTERM, seconds(8)), 0) << service_->output();
  }
  static MiddlewareOptions middleware(const Wire& wire, int seed) {
    return middleware_options((wire.lossy ? kLoss + std::to_string(seed) + ":" : "") + wire.middleware, wire.domain);
  }

 private:
  Folder folder_;
  std::unique_ptr<Service> service_;
};

/// An env_service and a scripted policy, which is to walk the episodes of an Environment without any wire.
class EnvProtocol : public ::testing::TestWithParam<Wire> {
 protected:
  EnvProtocol() : run_("env-protocol-" + std::to_string(getpid())), host_(GetParam(), run_), policy_(new_policy()) {
    spdlog::set_level(spdlog::level::warn);
  }
  ~EnvProtocol() override { spdlog::set_level(spdlog::level::info); }

  /// Returns another process of the policy_service.
  std::unique_ptr<ScriptedPolicy> new_policy() {
    auto policy = std::make_unique<ScriptedPolicy>(SummerService::middleware(GetParam(), 2), run_, "env-summer");
    policy->walker = &blind_;
    return policy;
  }
  /// Commands training on so many frames; false when it does not come beyond `steps`.
  bool trains(std::uint32_t frames, std::uint64_t steps) {
    policy_->command(settings(msg::TRAIN, frames, 64));
    return policy_->until([&] { return policy_->steps() > steps; });
  }

  /// Expects `count` episodes, the same as those of these settings and this walker without a wire.
  void expect_evaluation(std::uint64_t count) {
    ASSERT_TRUE(policy_->until([&] { return policy_->recorded == count; }));
    const Traversal traversal = summer();
    Environment environment(traversal, kSummerAgents);
    BlindSweep walker(64);
    const auto expected = evaluate(environment, policy_->commanded(), walker);
    ASSERT_EQ(policy_->episodes.size(), expected.size());
    std::uint64_t number = 0;
    for (const auto& [episode, stat] : policy_->episodes) {
      EXPECT_EQ(episode, ++number) << "without gaps, from 1";
      ASSERT_TRUE(expected.contains(static_cast<int>(stat.task())));
      const Environment::Episode& other = expected.at(static_cast<int>(stat.task()));
      EXPECT_TRUE(same(stat.settings(), policy_->commanded().settings()));
      EXPECT_TRUE(stat.evaluation());
      EXPECT_EQ(std::string(stat.traversal().c_str()), "summer");
      EXPECT_EQ(static_cast<int>(stat.agent()), other.agent);
      EXPECT_EQ(static_cast<int>(stat.start()), other.start);
      EXPECT_EQ(static_cast<int>(stat.goal()), other.goal);
      EXPECT_EQ(static_cast<int>(stat.steps()), other.steps);
      EXPECT_EQ(static_cast<int>(stat.shortest()), other.shortest);
      EXPECT_EQ(stat.reward(), other.reward);
      EXPECT_EQ(stat.completed(), other.completed);
    }
  }

  static msg::TaskSettings tasks(std::uint32_t count) { return evaluation(count, 64, 64); }
  static msg::TaskSettings idle() {
    msg::TaskSettings settings;
    settings.task_mode() = msg::IDLE;
    return settings;
  }

  const std::string run_;
  SummerService host_;
  BlindSweep blind_{64};
  std::unique_ptr<ScriptedPolicy> policy_;
};

TEST_P(EnvProtocol, WholeEvaluation) {
  const std::uint32_t count = GetParam().lossy ? 20 : 100;  // each loss costs 50 ms
  policy_->command(tasks(count));
  expect_evaluation(count);
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

TEST_P(EnvProtocol, ScenesAreForWhoeverWatches) {
  ASSERT_TRUE(trains(64, 10));
  policy_->node.create_reader<msg::Scene>();
  msg::Scene scene;
  const Clock::time_point since = Clock::now();
  int scenes = 0;
  std::uint64_t step = 0;
  ASSERT_TRUE(policy_->until([&] {
    while (policy_->node.take(scene)) {
      ++scenes;
      EXPECT_GE(scene.step() + (GetParam().lossy ? 1000 : 0), step);
      step = scene.step();
    }
    return scenes >= 8;
  }));
  const double elapsed = std::chrono::duration<double>(Clock::now() - since).count();
  EXPECT_LE(scenes, 10 * elapsed + 3 + (GetParam().lossy ? scenes : 0)) << "no more than a person can follow";
  EXPECT_TRUE(same(scene.settings(), policy_->commanded().settings()));
  EXPECT_EQ(scene.frame().size(), std::size_t{kSummerAgents});
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] {
    while (policy_->node.take(scene)) continue;
    return scene.task_mode() == msg::IDLE;
  })) << "nobody is anywhere";
  EXPECT_TRUE(scene.frame().empty());
}

INSTANTIATE_TEST_SUITE_P(Wires, EnvProtocol, ::testing::ValuesIn(kWires), wire_name);

}  // namespace
}  // namespace citylearn::testing
