// SPDX-License-Identifier: Apache-2.0
// One env_service and a scripted policy: over each vendor with the real program, over a transport that loses, repeats
// and reorders, and within this process. Whatever happens on the way, the episodes are those of an Environment walked
// by hand.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cstring>

#include "core/wire/transfer.h"
#include "tests/paths.h"
#include "tests/support/env.h"
#include "tests/support/env_service_thread.h"
#include "tests/support/options.h"
#include "tests/support/recorder.h"
#include "tests/support/scripted_policy.h"
#include "tests/support/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kFrames = 200, kAgents = 8;
constexpr char kLoss[] = "lossy,drop=0.2,repeat=0.2,reorder=0.2,seed=";

struct Wire {
  const char* name;
  const char* middleware;
  std::uint32_t domain;
  bool lossy;
};

Traversal summer() { return make_dataset("synthetic", "", {{"frames", kFrames}, {"images", 0}})->load("summer"); }

/// An env_service on traversal `summer` of a small synthetic city, as a program or (inprocess) as a thread.
class Host {
 public:
  Host(const Wire& wire, const std::string& run, const std::vector<std::string>& recorders = {}) {
    if (std::string(wire.middleware) != "inprocess") {
      std::vector<std::string> command{CITYLEARN_ENV_SERVICE, "--synthetic-images", "0", "--session", run};
      command.insert(command.end(),
                     {"--domain", std::to_string(wire.domain), "--middleware", middleware(wire, 1).name, "--agents",
                      std::to_string(kAgents), "--synthetic-frames", std::to_string(kFrames)});
      for (const std::string& recorder : recorders) command.insert(command.end(), {"--recorders", recorder});
      service_ = std::make_unique<Service>(command, folder_ / "log");
      return;
    }
    EnvServiceOptions options;
    options.agents = kAgents;
    options.recorders = recorders;
    options.node.session = run;
    options.node.middleware = middleware(wire, 1);
    thread_ = std::make_unique<EnvServiceThread>(options, summer());
  }
  ~Host() {
    if (service_) {
      EXPECT_EQ(service_->end(SIGTERM, seconds(8)), 0)
          << service_->output();  // recorders of this process may seem to live
    }
  }
  static MiddlewareOptions middleware(const Wire& wire, int seed) {
    return middleware_options((wire.lossy ? kLoss + std::to_string(seed) + ":" : "") + wire.middleware, wire.domain);
  }

 private:
  Folder folder_;
  std::unique_ptr<EnvServiceThread> thread_;
  std::unique_ptr<Service> service_;
};

class EnvProtocol : public ::testing::TestWithParam<Wire> {
 protected:
  EnvProtocol() : run_("env-protocol-" + std::to_string(getpid())), host_(GetParam(), run_), policy_(new_policy()) {
    spdlog::set_level(spdlog::level::warn);
  }

  std::unique_ptr<ScriptedPolicy> new_policy() const {
    return std::make_unique<ScriptedPolicy>(Host::middleware(GetParam(), 2), run_, "env-summer");
  }

  /// All `count` episodes come, and are those of the same settings and walker without any wire.
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
  std::unique_ptr<ScriptedPolicy> policy_;
  BlindSweep blind_{64};
};

TEST_P(EnvProtocol, TellsWhatItHosts) {
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > 0 && policy_->statuses > 0; }));
  const Traversal traversal = summer();
  const msg::TraversalInfo& info = policy_->info;
  EXPECT_EQ(std::string(info.dataset().c_str()), "synthetic");
  EXPECT_EQ(std::string(info.traversal().c_str()), "summer");
  EXPECT_EQ(std::string(info.condition().c_str()), "summer");
  EXPECT_EQ(info.hash(), traversal.hash());
  EXPECT_EQ(info.frames(), 200u);
  EXPECT_EQ(info.feature_dimension(), 64u);
  EXPECT_EQ(info.agents(), 8u);
  EXPECT_EQ(info.chunks(), 2u) << "200 x 65 floats are 52,000 bytes";
  EXPECT_FALSE(info.by_reference());
  EXPECT_EQ(info.settings().version(), 0u) << "nobody has commanded it";
  const int before = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos >= before + 2; })) << "again every second";
  EXPECT_EQ(policy_->status.service_state(), msg::WAITING);
  EXPECT_EQ(policy_->observations, 0) << "nothing to see before settings";
}

TEST_P(EnvProtocol, HandsOutItsTraversal) {
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > 0; }));
  const Traversal traversal = summer();
  policy_->request(traversal.hash() + 1, {0, 1});
  policy_->until([&] { return !policy_->chunks.empty(); }, milliseconds(100));
  EXPECT_TRUE(policy_->chunks.empty()) << "another traversal was asked for";
  ASSERT_TRUE(until_asking(
      [&] {
        policy_->request(traversal.hash(), {1, 0, 77});
      },
      [&] { return policy_->chunks.size() == 2; }));
  Transfer transfer({traversal.hash(), 200, 64});
  for (const auto& [index, chunk] : policy_->chunks) {
    EXPECT_EQ(chunk.chunk(), index);
    EXPECT_EQ(transfer.take(chunk), Transfer::Taken::kYes);
  }
  ASSERT_TRUE(transfer.complete());
  EXPECT_EQ(transfer.positions, traversal.positions);
  EXPECT_EQ(transfer.features, traversal.features);
  const auto& first = policy_->chunks.at(0).data();  // as idl/traversal.idl says, byte by byte
  EXPECT_EQ(std::memcmp(first.data() + 3 * 65 * 4, &traversal.positions[3], 4), 0);
  EXPECT_EQ(std::memcmp(first.data() + 3 * 65 * 4 + 4, traversal.feature(3).data(), 64 * 4), 0);
}

TEST_P(EnvProtocol, ByReferenceObservationsNameTheirFramesAndNothingElseChanges) {
  const std::uint32_t count = 16;
  policy_->walker = &blind_;
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
  policy_->walker = &blind_;
  policy_->command(tasks(count));
  expect_evaluation(count);
}

TEST_P(EnvProtocol, LostActionsOnlyCostTime) {
  policy_->walker = &blind_;
  policy_->ignore_every = 7;
  policy_->command(tasks(16));
  expect_evaluation(16);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.resent() > 5; }));
}

TEST_P(EnvProtocol, RepeatedActionsChangeNothing) {
  policy_->walker = &blind_;
  policy_->copies = 3;
  policy_->command(tasks(24));
  expect_evaluation(24);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.repeated() > 50; }));
}

TEST_P(EnvProtocol, ActionsOfOtherSettingsStepsAndIncarnationsChangeNothing) {
  policy_->walker = &blind_;
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
  policy_->walker = &blind_;
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
  policy_->walker = &blind_;
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
  policy_->walker = &blind_;
  policy_->command(settings(msg::TRAIN, 64, 64));
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 30; }));
  const std::uint64_t last = policy_->recorded;
  const msg::Observation old = policy_->seen;
  policy_.reset();
  policy_ = new_policy();
  policy_->walker = &blind_;
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
  policy_->walker = &blind_;
  policy_->command(settings(msg::TRAIN, 32, 64));
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 5; }));
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] { return policy_->in_force(); }));
  EXPECT_EQ(policy_->info.settings().version(), 2u);
  ASSERT_TRUE(policy_->until([&] { return policy_->status.service_state() == msg::WAITING; }));
  const int before = policy_->observations, infos = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos >= infos + 2; })) << "who comes next must find it";
  EXPECT_EQ(policy_->observations, before);
}

TEST_P(EnvProtocol, RefusedSettingsAreToldAndNotInForce) {
  policy_->walker = &blind_;
  policy_->command(settings(msg::TRAIN, 32, 64));
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 5; }));
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
  policy_->walker = &blind_;
  policy_->acknowledge = false;
  policy_->command(tasks(count));
  ASSERT_TRUE(policy_->until([&] { return policy_->recorded == count; }));
  const int before = policy_->episode_messages;
  ASSERT_TRUE(policy_->until([&] { return policy_->episode_messages >= before + static_cast<int>(count); })) << "again";
  // Acknowledged in part: only the rest is repeated, and says so, once what was on its way has come.
  const auto newest = [&](const auto& entry) { return entry.first > part && entry.second.acknowledged() == part; };
  const auto only_the_rest = [&] {
    return policy_->episodes.size() == count - part &&
           std::all_of(policy_->episodes.begin(), policy_->episodes.end(), newest);
  };
  const Clock::time_point deadline = Clock::now() + kPatience;
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
TEST_P(EnvProtocol, EveryRecorderGetsEveryEpisode) {
  const std::uint32_t count = GetParam().lossy ? 30 : 600;
  const std::string run = run_ + "-recorders";
  const Host host(GetParam(), run, {"dashboard"});
  ScriptedPolicy policy(Host::middleware(GetParam(), 5), run, "env-summer");
  policy.walker = &blind_;
  msg::TaskSettings with = tasks(count);
  with.policy() = "blind";
  with.update() = 7;
  with.run_id() = 8;
  policy.command(with);
  ASSERT_TRUE(policy.until([&] { return policy.recorded == count; }));
  EpisodeStore store;
  auto& stored = store["env-summer"];
  {
    Recorder dashboard(Host::middleware(GetParam(), 6), run, "dashboard", store);
    ASSERT_TRUE(dashboard.until([&] { return stored.size() >= count / 3; }));
  }
  Recorder dashboard(Host::middleware(GetParam(), 7), run, "dashboard", store);
  ASSERT_TRUE(dashboard.until([&] { return dashboard.recorded["env-summer"] == count; }));
  EXPECT_EQ(stored.size(), count);
  // And the env_service knows it.
  policy.command(tasks(8));
  ASSERT_TRUE(dashboard.until([&] {
    policy.spin();
    return std::any_of(stored.begin(), stored.end(),
                       [&](const auto& entry) { return entry.second.acknowledged() >= count; });
  }));
  for (const auto& [number, stat] : stored) {
    if (number > count) break;
    EXPECT_EQ(std::string(stat.policy().c_str()), "blind");
    EXPECT_EQ(stat.update(), 7u);
    EXPECT_EQ(stat.run_id(), 8u);
    ASSERT_EQ(stat.path().size(), (stat.steps() + 3) / 4);
    std::int64_t place = stat.start();
    for (std::size_t i = 0; i < stat.steps(); ++i) {
      const int action = stat.path()[i / 4] >> 2 * (i % 4) & 3;
      place += action == kNext ? 1 : action == kPrevious ? -1 : 0;
    }
    EXPECT_EQ(place == static_cast<std::int64_t>(stat.goal()), stat.completed()) << "the path leads to the goal";
  }
}

TEST_P(EnvProtocol, ScenesAreForWhoeverWatches) {
  policy_->walker = &blind_;
  msg::TaskSettings with = settings(msg::TRAIN, 64, 64);
  with.first_frame() = 20;
  with.policy() = "blind";
  policy_->command(with);
  ASSERT_TRUE(policy_->until([&] { return policy_->steps() > 10; }));
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
  EXPECT_EQ(scene.task_mode(), msg::TRAIN);
  EXPECT_EQ(std::string(scene.policy().c_str()), "blind");
  EXPECT_EQ(std::string(scene.traversal().c_str()), "summer");
  EXPECT_EQ(scene.traversal_hash(), policy_->info.hash());
  EXPECT_EQ(scene.first_frame(), 20u);
  EXPECT_EQ(scene.frames(), 64u);
  ASSERT_EQ(scene.frame().size(), std::size_t{kAgents});
  for (std::size_t agent = 0; agent < kAgents; ++agent) {
    EXPECT_TRUE(scene.position()[agent] >= 20 && scene.position()[agent] < 84);
    EXPECT_EQ(scene.frame()[agent], scene.position()[agent]);
    EXPECT_GE(scene.steps()[agent], static_cast<std::uint32_t>(std::abs(static_cast<int>(scene.position()[agent]) -
                                                                        static_cast<int>(scene.start()[agent]))));
  }
  policy_->command(idle());
  ASSERT_TRUE(policy_->until([&] {
    while (policy_->node.take(scene)) continue;
    return scene.task_mode() == msg::IDLE;
  })) << "nobody is anywhere";
  EXPECT_TRUE(scene.frame().empty());
}

TEST_P(EnvProtocol, TellsWhereItsFramesWereRecorded) {
  ASSERT_TRUE(policy_->until([&] { return policy_->infos > 0; }));
  const Traversal traversal = summer();
  policy_->node.create_reader<msg::MapChunk>();
  msg::MapRequest request;
  request.environment() = "env-summer";
  request.hash() = traversal.hash();
  msg::MapChunk chunk;
  const auto get = [&](std::uint32_t first) {
    request.first() = first;
    return until_asking([&] { policy_->node.publish(request); },
                        [&] {
                          bool found = false;
                          while (!found && policy_->node.take(chunk)) found = chunk.first() == first;
                          return found;
                        });
  };
  ASSERT_TRUE(get(0));
  EXPECT_EQ(chunk.hash(), traversal.hash());
  EXPECT_EQ(chunk.frames(), 200u);
  EXPECT_EQ(chunk.position(), traversal.positions);
  EXPECT_EQ(chunk.latitude(), traversal.latitude);
  EXPECT_EQ(chunk.longitude(), traversal.longitude);
  ASSERT_TRUE(get(150));
  EXPECT_EQ(chunk.position(), std::vector<float>(traversal.positions.begin() + 150, traversal.positions.end()));
  const std::uint64_t before = policy_->status.rejected();
  request.first() = 200;
  policy_->node.publish(request);
  ASSERT_TRUE(policy_->until([&] {
    if (GetParam().lossy) policy_->node.publish(request);
    return policy_->status.rejected() > before;
  })) << "beyond the last frame";
}

TEST_P(EnvProtocol, SilentPolicyIsWaitedFor) {
  policy_->walker = &blind_;
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

INSTANTIATE_TEST_SUITE_P(Wires, EnvProtocol,
                         ::testing::Values(Wire{"cyclonedds", "cyclonedds", 40, false},
                                           Wire{"fastdds", "fastdds", 41, false},
                                           Wire{"inprocess", "inprocess", 42, false},
                                           Wire{"lossy_cyclonedds", "cyclonedds", 43, true},
                                           Wire{"lossy_inprocess", "inprocess", 44, true}),
                         [](const auto& wire) { return std::string(wire.param.name); });

}  // namespace
}  // namespace citylearn::testing
