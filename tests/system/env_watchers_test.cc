// SPDX-License-Identifier: Apache-2.0
// What an env_service tells every reader: what it hosts, its scenes, and its episodes.
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>

#include "core/wire/transfer.h"
#include "tests/support/env/env_protocol.h"
#include "tests/support/records/recorder.h"

namespace citylearn::testing {
namespace {

using EnvWatchers = EnvProtocol;

TEST_P(EnvWatchers, TellsWhatItHosts) {
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
  EXPECT_FALSE(info.by_reference());
  EXPECT_EQ(info.settings().version(), 0u) << "nobody has commanded it";
  const int before = policy_->infos;
  ASSERT_TRUE(policy_->until([&] { return policy_->infos >= before + 2; })) << "again every second";
  EXPECT_EQ(policy_->status.service_state(), msg::WAITING);
  EXPECT_EQ(policy_->observations, 0) << "nothing to see before settings";
}

TEST_P(EnvWatchers, HandsOutItsTraversal) {
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
    EXPECT_EQ(transfer.take(chunk), Taken::kYes);
  }
  ASSERT_TRUE(transfer.complete());
  EXPECT_EQ(transfer.positions, traversal.positions);
  EXPECT_EQ(transfer.features, traversal.features);
}

TEST_P(EnvWatchers, EveryRecorderGetsEveryEpisode) {
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
  // And the env_service knows it. The next eight episodes do not say so when the acknowledgement was lost: then the
  // eight after them do.
  std::uint64_t commanded = count;
  ASSERT_TRUE(dashboard.until([&] {
    policy.spin();
    if (policy.recorded >= commanded) {
      policy.command(tasks(8));
      commanded += 8;
    }
    return std::any_of(stored.begin(), stored.end(),
                       [&](const auto& entry) { return entry.second.log().first() > count; });
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

TEST_P(EnvWatchers, ScenesAreForWhoeverWatches) {
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

INSTANTIATE_TEST_SUITE_P(Wires, EnvWatchers, ::testing::ValuesIn(kWires), wire_name);

}  // namespace
}  // namespace citylearn::testing
