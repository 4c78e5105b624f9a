// SPDX-License-Identifier: Apache-2.0
// The dashboard's recorder, killed again and again while services train: it loses nothing and has nothing twice.
#include <gtest/gtest.h>

#include <algorithm>
#include <span>

#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/ledger.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr int kKills = 20;

std::int64_t recorded(const std::string& path, const std::string& table = "episodes") {
  return open_database(path).execAndGet("SELECT COUNT(*) FROM " + table).getInt64();
}

TEST(DashboardRecorder, NothingIsLostOrDoubledWhenItIsKilledTwentyTimes) {
  Trial run("simulated");
  const std::string store = run.folder() / "dashboard.sqlite";
  const auto env = run.env("summer", {"--agents", "16", "--recorders", "dashboard", "--linger", "60"});
  const auto training = run.policy({"--agent", "place_filter", "--steps", "1000000000", "--checkpoint-every", "20",
                                    "--output", run.folder() / "out", "--evaluate", "summer"});
  int busy = 0;
  for (int kill = 0; kill < kKills; ++kill) {
    const auto victim = run.recorder(store);
    // In the middle of recording, as long as there is something to be recorded.
    const std::int64_t before = recorded(store);
    busy += poll_until([&] { return recorded(store) > before; }, seconds(2));
    ASSERT_EQ(victim->end(SIGKILL, kLongWait), 128 + SIGKILL) << victim->output();
  }
  EXPECT_GE(busy, kKills / 2);
  const auto last = run.recorder(store);
  // Until it has asked for all the updates that its predecessors missed.
  const std::int64_t before = recorded(store, "training");
  ASSERT_TRUE(poll_until(
      [&] {
        return recorded(store, "training") > before &&
               open_database(store)
                       .execAndGet(
                           "SELECT COUNT(*) = MAX(key) - MIN(key) + 1 AND MIN(key) % (1 << 40) = 1 FROM training")
                       .getInt64() == 1;
      },
      kLongWait));
  ASSERT_TRUE(training->end(SIGTERM, kLongWait).has_value()) << training->output();
  const auto evaluation = run.policy({"--mode", "evaluate", "--agent", "blind", "--tasks", "64", "--evaluate", "summer",
                                      "--output", run.folder() / "blind"});
  ASSERT_EQ(evaluation->wait(kLongWait), 0) << evaluation->output();
  // it stays until the dashboard has everything
  ASSERT_EQ(env->end(SIGTERM, kLongWait), 0) << env->output();
  ASSERT_EQ(last->end(SIGTERM, kLongWait), 0) << last->output();

  // The env_service's own count, without gaps; and the policy_service, a recorder of its own, knows of nothing else.
  const Ledger mine = in_store(store), theirs = in_csv(run.folder() / "out/episodes.csv");
  EXPECT_GT(entries(theirs), 100u);
  for (const auto& [source, episodes] : theirs)
    EXPECT_TRUE(std::includes(mine.at(source).begin(), mine.at(source).end(), episodes.begin(), episodes.end()));
  EXPECT_TRUE(contains(env->output(), "stops: " + std::to_string(entries(mine)) + " episodes, all acknowledged"));
  EXPECT_EQ(open_database(store).execAndGet("SELECT MAX(episode) FROM episodes").getInt64(),
            static_cast<std::int64_t>(entries(mine)));

  StoreReader reader(store);
  // The evaluation may have been over before its RunInfo was heard: its tasks then stand under the run's name.
  EXPECT_EQ(recorded(store, "episodes WHERE evaluation = 1 AND policy = 'blind'"), 64);
  EXPECT_EQ(reader.episodes(), entries(mine));
  RunRow trained;
  for (const RunRow& row : reader.runs())
    if (row.agent == "place_filter") trained = row;
  EXPECT_TRUE(trained.ended);
  EXPECT_GE(trained.recorded, entries(theirs));
  std::uint64_t updates = 0;
  reader.training(trained.id, [&](std::span<const double>) { ++updates; });
  ASSERT_TRUE(trained.newest);
  EXPECT_EQ(updates, trained.newest->update) << "those of the time when it was gone were asked for";
  for (const EpisodeRow& row : reader.episodes(trained.id, {}, false, 200)) {
    const auto replay = reader.episode(row.rowid);
    ASSERT_TRUE(replay->path) << row.rowid;
    EXPECT_EQ(replay->path->size(), (row.steps + 3) / 4);
    EXPECT_TRUE(replay->hash);
  }
}

}  // namespace
}  // namespace citylearn::testing
