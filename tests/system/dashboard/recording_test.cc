// SPDX-License-Identifier: Apache-2.0
// Recording a run of real services, and playing it: to a recorder and to the dashboard.
#include <gtest/gtest.h>

#include <set>

#include "dashboard/store/database.h"
#include "tests/paths.h"
#include "tests/support/processes/service.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/recordings.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

/// Returns all that is kept of each episode, without where and when it was stored.
std::set<std::string> episodes_in(const std::string& path) {
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(
      database,
      "SELECT environment || ' ' || incarnation || ' ' || episode || ' ' || agent || ' ' || evaluation || ' ' "
      "|| start || ' ' || goal || ' ' || steps || ' ' || reward || ' ' || completed || ' ' || hex(path) "
      "FROM episodes e JOIN sources s ON s.id = e.source");
  std::set<std::string> all;
  while (rows.executeStep()) EXPECT_TRUE(all.insert(value_at<std::string>(rows, 0)).second);
  return all;
}

std::set<std::string> updates_in(const std::string& path) {
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database, "SELECT key & ((1 << 40) - 1) FROM training");
  std::set<std::string> all;
  while (rows.executeStep()) EXPECT_TRUE(all.insert(value_at<std::string>(rows, 0)).second);
  return all;
}

class Vendors : public VendorTest {};
CITYLEARN_EACH_VENDOR(Vendors);

TEST_P(Vendors, AReplayedRunIsTheRun) {
  Trial trial(GetParam());
  const std::string file = trial.folder() / "run.mcap";
  const auto record = trial.program(CITYLEARN_RECORD, "record", {"--output", file});
  ASSERT_TRUE(record->says("records to", kLongWait)) << record->output();
  {
    const auto recorder = trial.recorder(trial.folder() / "original.sqlite");
    const auto env = trial.env("summer", {"--recorders", "dashboard", "--linger", "60"});
    const auto policy = trial.train(40, "out");
    ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output();
    ASSERT_EQ(env->end(SIGTERM, kLongWait), 0) << env->output();
    ASSERT_EQ(recorder->end(SIGTERM, kLongWait), 0) << recorder->output();
  }
  ASSERT_EQ(record->end(SIGINT, kLongWait), 0) << record->output();
  EXPECT_TRUE(contains(record->output(), "citylearn/episode_stat"));
  std::string missing = "?";
  EXPECT_FALSE(all_of(file, &missing).empty());
  EXPECT_EQ(missing, "");

  // To the next recorder that comes: what the first one has, it has too.
  const auto recorder = trial.recorder(trial.folder() / "replayed.sqlite");
  const auto replay = trial.program(CITYLEARN_REPLAY, "replay", {file, "--speed", "max"});
  ASSERT_EQ(replay->wait(kLongWait), 0) << replay->output();
  ASSERT_EQ(recorder->end(SIGTERM, kLongWait), 0) << recorder->output();
  const auto original = episodes_in(trial.folder() / "original.sqlite");
  EXPECT_GT(original.size(), 50u);
  EXPECT_EQ(episodes_in(trial.folder() / "replayed.sqlite"), original) << replay->output();
  EXPECT_EQ(updates_in(trial.folder() / "replayed.sqlite").size(), 40u) << replay->output();

  const auto nothing = trial.program(CITYLEARN_REPLAY, "replay", {file, "--speed", "max", "--topics", "trajectory"});
  EXPECT_EQ(nothing->wait(kLongWait), 1) << "one process sends none";
  EXPECT_TRUE(contains(nothing->output(), "run.mcap: holds no message that is played")) << nothing->output();

  // The dashboard opens it by itself.
  const auto dashboard =
      trial.dashboard({"--open", file, "--speed", "max", "--port", "0", "--store", trial.folder() / "opened.sqlite"});
  ASSERT_TRUE(dashboard->says("the recording has ended", kLongWait)) << dashboard->output();
  ASSERT_EQ(dashboard->end(SIGTERM, kLongWait), 0) << dashboard->output();
  EXPECT_EQ(episodes_in(trial.folder() / "opened.sqlite"), original) << dashboard->output();
  EXPECT_EQ(updates_in(trial.folder() / "opened.sqlite").size(), 40u) << dashboard->output();
}

TEST_P(Vendors, AKilledRecordingIsRead) {
  Trial trial(GetParam());
  const std::string file = trial.folder() / "run.mcap";
  const auto record =
      trial.program(CITYLEARN_RECORD, "record", {"--output", file, "--topics", "trajectory,learner_info"});
  ASSERT_TRUE(record->says("records to", kLongWait)) << record->output();
  const auto env = trial.env("summer");
  {
    const auto first = trial.train(30, "first", {"--role", "learner", "--trainer-agents", "8"});
    const auto actor = trial.policy({"--role", "actor", "--id", "actor"});
    ASSERT_EQ(first->wait(kLongWait), 0) << first->output();
  }
  const auto trajectories = [&] {
    std::size_t count = 0;
    for (const Heard& heard : all_of(file)) count += heard.topic == "citylearn/trajectory";
    return count;
  };
  // 30 updates of 8 agents, but for what the actor may send before it is acknowledged (--window): the recorder may know
  // its topic later than the learner does. A chunk is on the disk a second after its first message.
  ASSERT_TRUE(poll_until([&] { return trajectories() >= 240 - 2 * 8; }, kLongWait))
      << trajectories() << " trajectories, " << record->output();
  ASSERT_EQ(record->end(SIGKILL, kLongWait), 128 + SIGKILL);
  EXPECT_GE(trajectories(), 240u - 2 * 8) << "what is on the disk is read";
}

}  // namespace
}  // namespace citylearn::testing
