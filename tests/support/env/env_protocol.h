// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>
#include <unistd.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/paths.h"
#include "tests/support/env/env.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/options.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {

inline constexpr int kFrames = 200, kAgents = 8;
inline constexpr char kLoss[] = "lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=";

struct Wire {
  const char* name;
  const char* middleware;
  std::uint32_t domain;
  bool lossy;
};

#ifdef CITYLEARN_SIMULATED
inline constexpr Wire kWires[] = {{"simulated", "simulated", 0, false}, {"lossy", "simulated", 0, true}};
#else
inline constexpr Wire kWires[] = {{"cyclonedds", "cyclonedds", 40, false}, {"fastdds", "fastdds", 41, false}};
#endif
inline std::string wire_name(const ::testing::TestParamInfo<Wire>& wire) { return wire.param.name; }

inline Traversal summer() {
  return make_dataset("synthetic", "", {{"frames", kFrames}, {"images", 0}})->load("summer");
}

/// An env_service on traversal `summer` of a small synthetic city.
class Host {
 public:
  Host(const Wire& wire, const std::string& run, const std::vector<std::string>& recorders = {}) {
    Arguments command{CITYLEARN_ENV_SERVICE, "--synthetic-images", "0", "--session", run};
    command.insert(command.end(), {"--domain", std::to_string(wire.domain), "--middleware", middleware(wire, 1).name,
                                   "--agents", std::to_string(kAgents), "--synthetic-frames", std::to_string(kFrames)});
    for (const std::string& recorder : recorders) command.insert(command.end(), {"--recorders", recorder});
    service_ = std::make_unique<Service>(command, folder_ / "log");
  }
  ~Host() {
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
    auto policy = std::make_unique<ScriptedPolicy>(Host::middleware(GetParam(), 2), run_, "env-summer");
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
    Environment environment(traversal, kAgents);
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

  /// Asks at once and every 200 ms, as what is asked or answered may be lost.
  bool until_asking(const std::function<void()>& ask, const std::function<bool()>& condition) {
    Clock::time_point next = Clock::now();
    return policy_->until([&] {
      if (Clock::now() >= next) ask(), next = Clock::now() + milliseconds(200);
      return condition();
    });
  }

  static msg::TaskSettings tasks(std::uint32_t count) { return evaluation(count, 64, 64); }
  static msg::TaskSettings idle() {
    msg::TaskSettings settings;
    settings.task_mode() = msg::IDLE;
    return settings;
  }

  const std::string run_;
  Host host_;
  BlindSweep blind_{64};
  std::unique_ptr<ScriptedPolicy> policy_;
};

}  // namespace citylearn::testing
