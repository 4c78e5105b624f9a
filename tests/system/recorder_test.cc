// SPDX-License-Identifier: Apache-2.0
// The dashboard's recorder beside real services: killed again and again while they train, it loses nothing and has
// nothing twice.
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <set>
#include <sstream>
#include <tuple>

#include "core/wire/node.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/records.h"
#include "tests/support/service.h"
#include "tests/support/trial.h"

namespace citylearn::testing {
namespace {

using std::chrono::seconds;
using Named = std::tuple<std::string, std::string, std::string>;  // environment, incarnation, episode

constexpr seconds kLong{120};
constexpr int kKills = 20;

/// Episodes that the policy_service recorded, which is a recorder of its own.
std::set<Named> in_csv(const std::string& path) {
  std::set<Named> all;
  std::ifstream in(path);
  std::string line, environment, incarnation, episode;
  std::getline(in, line);
  while (std::getline(in, line)) {
    std::istringstream fields(line);
    std::getline(fields, environment, ',');
    std::getline(fields, incarnation, ',');
    std::getline(fields, episode, ',');
    EXPECT_TRUE(all.emplace(environment, incarnation, episode).second) << "twice: " << line;
  }
  return all;
}

std::set<Named> in_store(const std::string& path) {
  SQLite::Database database = open_database(path);
  SQLite::Statement rows(database,
                         "SELECT environment, incarnation, episode FROM episodes e JOIN sources s ON s.id = e.source");
  std::set<Named> all;
  while (rows.executeStep())
    EXPECT_TRUE(
        all.emplace(value_at<std::string>(rows, 0), value_at<std::string>(rows, 1), value_at<std::string>(rows, 2))
            .second);
  return all;
}

std::int64_t recorded(const std::string& path, const std::string& table = "episodes") {
  return open_database(path).execAndGet("SELECT COUNT(*) FROM " + table).getInt64();
}

class Vendors : public ::testing::TestWithParam<const char*> {
 protected:
  int domain() const { return std::string(GetParam()) == "fastdds" ? 211 : 212; }
};
INSTANTIATE_TEST_SUITE_P(, Vendors, ::testing::Values("fastdds", "cyclonedds"),
                         [](const auto& vendor) { return std::string(vendor.param); });

TEST_P(Vendors, NothingIsLostOrDoubledWhenItIsKilledTwentyTimes) {
  Trial run(GetParam(), domain());
  const std::string store = run.folder() / "dashboard.sqlite";
  int started = 0;
  const auto recorder = [&] {
    return std::make_unique<Service>(Arguments{CITYLEARN_RECORDER_PROCESS, GetParam(), std::to_string(domain()), store},
                                     run.folder() / ("recorder-" + std::to_string(++started) + ".log"));
  };
  const auto env = run.env("summer", {"--agents", "16", "--recorders", "dashboard", "--linger", "60"});
  const auto training = run.policy({"--agent", "place_filter", "--steps", "1000000000", "--checkpoint-every", "20",
                                    "--output", run.folder() / "out", "--evaluate", "summer"});
  int busy = 0;
  for (int kill = 0; kill < kKills; ++kill) {
    const auto victim = recorder();
    ASSERT_TRUE(victim->says("records", kLong)) << victim->output();
    // In the middle of recording, as long as there is something to be recorded.
    const std::int64_t before = recorded(store);
    busy += poll_until([&] { return recorded(store) > before; }, seconds(2));
    victim->send(SIGKILL);
    ASSERT_EQ(victim->wait(kLong), 128 + SIGKILL) << victim->output();
  }
  EXPECT_GE(busy, kKills / 2);
  const auto last = recorder();
  ASSERT_TRUE(last->says("records", kLong)) << last->output();
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
      kLong));
  training->send(SIGTERM);
  ASSERT_TRUE(training->wait(kLong).has_value()) << training->output();
  const auto evaluation = run.policy({"--mode", "evaluate", "--agent", "blind", "--tasks", "64", "--evaluate", "summer",
                                      "--output", run.folder() / "blind"});
  ASSERT_EQ(evaluation->wait(kLong), 0) << evaluation->output();
  env->send(SIGTERM);  // it stays until the dashboard has everything
  ASSERT_EQ(env->wait(kLong), 0) << env->output();
  last->send(SIGTERM);
  ASSERT_EQ(last->wait(kLong), 0) << last->output();

  // The env_service's own count, without gaps; and the policy_service, a recorder of its own, knows of nothing else.
  const std::set<Named> mine = in_store(store), theirs = in_csv(run.folder() / "out/episodes.csv");
  EXPECT_GT(theirs.size(), 100u);
  EXPECT_TRUE(std::includes(mine.begin(), mine.end(), theirs.begin(), theirs.end()));
  EXPECT_NE(env->output().find("stops: " + std::to_string(mine.size()) + " episodes, all acknowledged"),
            std::string::npos)
      << mine.size() << "\n"
      << env->output();
  EXPECT_EQ(open_database(store).execAndGet("SELECT MAX(episode) FROM episodes").getInt64(),
            static_cast<std::int64_t>(mine.size()));

  StoreReader reader(store);
  // The evaluation may have been over before its RunInfo was heard: its tasks then stand under the run's name.
  EXPECT_EQ(recorded(store, "episodes WHERE evaluation = 1 AND policy = 'blind'"), 64);
  EXPECT_EQ(reader.episodes(), mine.size());
  RunRow trained;
  for (const RunRow& row : reader.runs())
    if (row.agent == "place_filter") trained = row;
  EXPECT_TRUE(trained.ended);
  EXPECT_GE(trained.recorded, theirs.size());
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

/// `many` messages to a reader that is there.
template <class... Messages>
void publish_each(Node& node, int many, Messages... messages) {
  for (int i = 0; i < many; ++i) (node.publish(messages), ...);
}

// What a killed recorder leaves behind: readers that acknowledge nothing, until their lease ends. Fast DDS 2.9 by
// itself hangs in one of some hundred deletions of their writers.
TEST(FastDds, AServiceEndsThoughItsRecorderDoesNotAnswer) {
  constexpr int kRounds = 30, kDomain = 213;
  const Folder folder;
  const Service recorder({CITYLEARN_RECORDER_PROCESS, "fastdds", std::to_string(kDomain), folder / "dashboard.sqlite"},
                         folder / "recorder.log");
  ASSERT_TRUE(recorder.says("records", kLong)) << recorder.output();
  for (int round = 0; round < kRounds; ++round) {
    recorder.send(SIGCONT);
    Node::Options options;
    options.middleware.name = "fastdds";
    options.middleware.domain = kDomain;
    options.service = "env_service";
    options.id = "env-summer";
    Node node(options);
    const Clock::time_point deadline = Clock::now() + kLong;
    const auto matched = [&] {
      return node.readers<msg::EpisodeStat>() > 0 && node.readers<msg::TrainingStat>() > 0 &&
             node.readers<msg::TraversalInfo>() > 0 && node.readers<msg::RunInfo>() > 0;
    };
    while (!matched() && Clock::now() < deadline) node.wait(Clock::now() + std::chrono::milliseconds(10));
    ASSERT_TRUE(matched());
    recorder.send(SIGSTOP);
    publish_each(node, 256, episode(1), training_stat(1), traversal_info(), run_info());
  }
}

}  // namespace
}  // namespace citylearn::testing
