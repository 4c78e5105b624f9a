// SPDX-License-Identifier: Apache-2.0
// The dashboard's store: nothing lost, nothing twice, whatever happens to the process or the file.
#include "dashboard/store/store.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <random>

#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "dashboard/store/database.h"
#include "dashboard/store/store_reader.h"
#include "tests/support/processes/service.h"
#include "tests/support/records/records.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

class StoreTest : public ::testing::Test {
 protected:
  Folder folder_;
  const std::string path_ = folder_ / "dashboard.sqlite";

  Store::Options options() const { return {path_, 0}; }
  std::string refusal() const {
    return error_of([&] { Store store(options()); });
  }
  std::int64_t number(const std::string& sql) const { return open_database(path_).execAndGet(sql).getInt64(); }
};

const Sender kEnvironment("demo", "env-summer", 7);
const Sender kPolicy("demo", "policy", 500);

TEST_F(StoreTest, RecordsEachEpisodeOnceInAnyOrderAndAcrossRestarts) {
  std::vector<msg::EpisodeStat> all = episodes(1, 300);
  const std::vector<msg::EpisodeStat> again = all;
  all.insert(all.end(), again.begin(), again.end());
  std::shuffle(all.begin(), all.end(), std::mt19937(1));
  std::size_t fresh = 0;
  for (std::size_t begin = 0; begin < all.size(); begin += 50) {
    Store store(options());  // a new process each time, as it were
    fresh += store.record(std::span(all).subspan(begin, 50));
  }
  EXPECT_EQ(fresh, 300u);
  EXPECT_EQ(number("SELECT COUNT(*) FROM episodes"), 300);
  EXPECT_EQ(number("SELECT COUNT(DISTINCT episode) FROM episodes"), 300);
  EXPECT_EQ(number("SELECT SUM(recorded) FROM runs"), 300);
  EXPECT_EQ(Store(options()).recorded_up_to(kEnvironment), 300u);
}

TEST_F(StoreTest, CountsUpToTheFirstGapAndKeepsWhatIsBehindIt) {
  std::vector<msg::EpisodeStat> all = episodes(1, 10);
  all.erase(all.begin() + 3);
  {
    Store store(options());
    EXPECT_EQ(store.recorded_up_to(kEnvironment), 0u);
    store.record(all);
    EXPECT_EQ(store.recorded_up_to(kEnvironment), 3u);
  }
  Store store(options());
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 3u);
  EXPECT_EQ(store.record(std::vector{episode(4), episode(7)}), 1u);
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 10u);
  // Its next process counts anew.
  EXPECT_EQ(store.record(std::vector{episode(1, "env-summer", 8)}), 1u);
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 10u);
  EXPECT_EQ(store.recorded_up_to(Sender("demo", "env-summer", 8)), 1u);
}

TEST_F(StoreTest, GoesOnFromWhatOthersRecordedAndSaysSo) {
  {
    Store store(options());
    std::vector<msg::EpisodeStat> some = {episode(7)};
    some[0].log().first(6);
    std::vector<Event> lost;
    EXPECT_EQ(store.record(some, &lost), 1u);
    ASSERT_EQ(lost.size(), 1u);
    EXPECT_EQ(lost[0].kind, "alarm");
    EXPECT_TRUE(contains(lost[0].text, "5 episodes up to number 5"));
    EXPECT_EQ(store.recorded_up_to(kEnvironment), 5u);
    EXPECT_EQ(store.events(10).size(), 1u);
  }
  Store store(options());
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 5u);
  EXPECT_EQ(store.record(std::vector{episode(6)}), 1u);
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 7u);
  EXPECT_EQ(store.record(std::vector{episode(3)}), 1u) << "a replay has it all the same";
}

TEST_F(StoreTest, TakesNumbersThatCannotBeForNothing) {
  Store store(options());
  msg::EpisodeStat zero = episode(0), huge = episode(~std::uint64_t{0}), strange = episode(1);
  strange.log().first(~std::uint64_t{0});
  EXPECT_EQ(store.record(std::vector{zero, huge, strange}), 0u);
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 0u);
  // Those of 64 bits that can be come back as they were.
  store.record(run_info(0, 500, 1, ~std::uint64_t{0}));
  EXPECT_EQ(StoreReader(path_).runs().at(0).seed, ~std::uint64_t{0});
}

TEST_F(StoreTest, ClaimsEpisodesThatCameBeforeTheirRun) {
  Store store(options());
  store.record(episodes(1, 5));
  store.record(std::vector{episode(6, "env-summer", 7, kJob + 1)});
  EXPECT_EQ(StoreReader(path_).run("demo")->recorded, 6u);
  EXPECT_TRUE(store.record(run_info()));
  StoreReader reader(path_);
  EXPECT_EQ(reader.run("demo")->recorded, 1u) << "of another job";
  const auto run = reader.run("demo/policy/1/1700000000000000");
  ASSERT_TRUE(run);
  EXPECT_EQ(run->recorded, 5u);
  store.record(std::vector{episode(7)});
  EXPECT_EQ(reader.run(run->name)->recorded, 6u);
  store.describe(traversal_info());
  const auto traversals = reader.traversals(run->id);
  ASSERT_EQ(traversals.size(), 1u);
  EXPECT_EQ(traversals[0].hash, 0xFEDCBA9876543210);
  EXPECT_EQ(traversals[0].agents, 16u);
}

TEST_F(StoreTest, KnowsRunsByTheirJobThroughRestartsAndEnds) {
  Store store(options());
  EXPECT_TRUE(store.record(run_info()));
  EXPECT_FALSE(store.record(run_info(10, 500, 2))) << "goes on";
  EXPECT_TRUE(store.record(run_info(8, 900, 1))) << "resumed";
  EXPECT_FALSE(store.record(run_info(12, 500, 3))) << "kept for late joiners by the one that is gone";
  EXPECT_TRUE(store.record(run_info(0, 901, 1, 1, kJob + 5))) << "the same options again are another run";
  StoreReader reader(path_);
  ASSERT_EQ(reader.runs().size(), 2u);
  EXPECT_EQ(store.liveness(reader.runs()[1].id).updates, 8u);
  EXPECT_TRUE(store.record(ended(run_info(20, 900, 2))));
  EXPECT_TRUE(reader.run("demo/policy/1/1700000000000000")->ended);
  EXPECT_FALSE(reader.run("demo/policy/1/1700000000000005")->ended);
  store.mark_ended(Sender("demo", "policy", 901));
  EXPECT_TRUE(reader.run("demo/policy/1/1700000000000005")->ended);
}

TEST_F(StoreTest, KeepsRunsOfOneIdApart) {
  Store store(options());
  store.record(run_info());
  store.record(training_stats(1, 10, 500, 0.25f));
  msg::RunInfo other = run_info(0, 900, 1);
  other.header().sender("mallory");
  EXPECT_TRUE(store.record(other));
  EXPECT_TRUE(store.record(run_info(0, 901, 1, 2))) << "another seed";
  EXPECT_EQ(store.record(std::vector{training_stat(1, 900, 0.5f)}), 0u) << "in the name of the first one";
  msg::TrainingStat stat = training_stat(1, 900, 0.5f);
  stat.header().sender("mallory");
  EXPECT_EQ(store.record(std::vector{stat}), 1u);
  EXPECT_EQ(store.record(training_stats(11, 12, 500, 0.25f)), 2u) << "the first one goes on";
  store.record(episodes(1, 5));
  StoreReader reader(path_);
  ASSERT_EQ(reader.runs().size(), 3u);
  EXPECT_EQ(reader.run("demo/policy/1/1700000000000000")->recorded, 5u) << "who was there first";
  EXPECT_EQ(number("SELECT COUNT(*) FROM training t JOIN runs r ON r.id = t.key >> 40 WHERE r.policy = 'policy'"), 12);
  EXPECT_EQ(number("SELECT COUNT(*) FROM training t JOIN runs r ON r.id = t.key >> 40 WHERE r.policy = 'mallory'"), 1);
}

TEST_F(StoreTest, FlushWritesWhatWasOnlyRemembered) {
  {
    Store store(options());
    store.record(run_info());
    store.record(run_info(77, 500, 2));
    EXPECT_EQ(number("SELECT updates FROM runs"), 0);
    store.flush(true);
  }
  EXPECT_EQ(number("SELECT updates FROM runs"), 77);
}

/// Reward of each update of the run, by a process's own: which of them the rows are.
std::vector<double> rewards(const std::string& path) {
  SQLite::Database database = open_database(path);
  SQLite::Statement row(database, "SELECT reward FROM training ORDER BY key");
  std::vector<double> all;
  while (row.executeStep()) all.push_back(row.getColumn(0).getDouble());
  return all;
}

TEST_F(StoreTest, AResumedRunReplacesTheUpdatesAfterItsCheckpoint) {
  {
    Store store(options());
    store.record(run_info());
    EXPECT_EQ(store.record(training_stats(1, 10, 500, 0.25f)), 10u);
    EXPECT_EQ(store.record(std::vector{training_stat(3, 499)}), 0u) << "an older process than the one heard of";
  }
  Store store(options());
  store.record(run_info(6, 900, 1));
  EXPECT_EQ(rewards(path_), std::vector<double>(10, 0.25)) << "a RunInfo alone, which anybody may send, removes none";
  EXPECT_EQ(store.record(training_stats(7, 8, 900, 0.75f)), 2u);
  EXPECT_EQ(store.record(std::vector{training_stat(9, 500)}), 0u) << "of the one that is gone";
  std::vector<double> expected(6, 0.25);
  expected.resize(8, 0.75);
  EXPECT_EQ(rewards(path_), expected);
  const NumberSet made = store.recorded_stats(Sender("demo", "policy", 900), kJob);
  EXPECT_TRUE(made.count(7, 8) == 2 && made.count(1, 10) == 2) << "the others are its predecessor's";
  msg::TrainingStat after_a_break = training_stat(20, 900, 0.75f);
  after_a_break.log() = log_position(9, kJob);
  EXPECT_EQ(store.record(std::vector{after_a_break}), 1u);
  EXPECT_EQ(store.recorded_stats(Sender("demo", "policy", 900), kJob).count(7, 20), 3u) << "counted without a gap";
  EXPECT_EQ(number("SELECT MAX(key & 1023) FROM training"), 20);
}

TEST_F(StoreTest, AResumedRunWhoseStartWasMissedReplacesThemToo) {
  Store store(options());
  store.record(run_info());
  store.record(training_stats(1, 10, 500, 0.25f));
  // First heard of when it has come as far as its predecessor: it began after update 4.
  store.record(run_info(10, 900, 1));
  EXPECT_EQ(rewards(path_).size(), 10u);
  std::vector<msg::TrainingStat> late = training_stats(5, 10, 900, 0.75f);
  std::reverse(late.begin(), late.end());
  store.record(late);
  std::vector<double> expected(4, 0.25);
  expected.resize(10, 0.75);
  EXPECT_EQ(rewards(path_), expected);
}

TEST_F(StoreTest, StatsOfUnknownRunsAreLeftOut) {
  Store store(options());
  EXPECT_EQ(store.record(training_stats(1, 3)), 0u);
  EXPECT_EQ(store.recorded_stats(kPolicy, kJob).reach(), 0u);
}

TEST_F(StoreTest, RemovesARunAndItsEpisodesButNotOneThatIsRunning) {
  Store store(options());
  store.record(run_info());
  store.record(episodes(1, 20));
  store.record(training_stats(1, 20));
  const std::string name = run_id(run_info());
  EXPECT_EQ(store.remove("demo/policy/1/2"), Store::Removal::kUnknown);
  EXPECT_EQ(store.remove(name), Store::Removal::kRunning);
  store.record(ended(run_info(20, 500, 2)));
  EXPECT_EQ(store.remove(name), Store::Removal::kDone);
  for (const std::string table : {"runs", "episodes", "training", "run_sources"})
    EXPECT_EQ(number("SELECT COUNT(*) FROM " + table), 0) << table;
  EXPECT_EQ(store.recorded_up_to(kEnvironment), 20u) << "what was recorded is not asked for again";
  EXPECT_EQ(store.record(episodes(1, 21)), 1u);
}

TEST_F(StoreTest, NamesAreNeverSql) {
  const std::string evil = "x'; DROP TABLE episodes; --\" \\ % \xF0\x9F\x9A\x8C";
  Store store(options());
  msg::EpisodeStat e = episode(1, evil);
  e.policy(evil);
  e.traversal(evil);
  store.record(std::vector{e});
  store.record(Event{1, evil, evil, evil, evil});
  StoreReader reader(path_);
  EpisodeFilter filter;
  filter.policy = filter.traversal = evil;
  const auto found = reader.episodes(reader.run("demo")->id, filter, false, 10);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].environment, evil);
  EXPECT_EQ(store.events(1).at(0).text, evil);
}

TEST_F(StoreTest, RunNamesWithSlashesStayApart) {
  msg::RunInfo one = run_info(), other = run_info();
  sign(one.header(), "b", 500, 1, "a/policy");
  sign(other.header(), "policy/b", 500, 1, "a");
  EXPECT_EQ(run_id(one), "a%2Fpolicy/b/1/1700000000000000");
  EXPECT_NE(run_id(one), run_id(other));
  EXPECT_EQ(run_id(std::string("50%")), "50%25");
}

TEST_F(StoreTest, OneDashboardAFile) {
  {
    Store store(options());
    EXPECT_TRUE(contains(refusal(), "another dashboard records here"));
    store.publish_writer("http://127.0.0.1:8080/ 0 dashboard 1\n");
    EXPECT_TRUE(contains(refusal(), "open http://127.0.0.1:8080/, or end it"));
  }
  EXPECT_EQ(refusal(), "");
}

TEST_F(StoreTest, OneDashboardAFileWhateverItsName) {
  const std::string link = folder_ / "link.sqlite", early = folder_ / "early.sqlite", later = folder_ / "later.sqlite";
  std::filesystem::create_symlink("dashboard.sqlite", link);
  std::filesystem::create_directory_symlink(".", folder_ / "folder");
  std::filesystem::create_symlink(folder_ / "folder/later.sqlite", early);  // leads to nothing yet
  const Store store(options()), created({early, 0});
  const auto refused = [](const std::string& path) {
    return contains(error_of([&] { const Store second({path, 0}); }), path + ": another dashboard records here");
  };
  EXPECT_TRUE(refused(link));
  EXPECT_TRUE(refused(folder_ / "folder/link.sqlite"));
  EXPECT_TRUE(refused(later));
  std::filesystem::create_symlink("circle", folder_ / "circle");
  EXPECT_TRUE(holds(error_of([&] { const Store second({folder_ / "circle", 0}); }), folder_ / "circle"));
}

TEST_F(StoreTest, OnlyItsOwnerReadsIt) {
  Store store(options());
  store.record(episodes(1, 1));
  for (const std::string name : {"", "-wal", "-shm", ".lock"}) {
    struct stat status {};
    ASSERT_EQ(::stat((path_ + name).c_str(), &status), 0) << name;
    EXPECT_EQ(status.st_mode & 0777, 0600u) << name;
  }
}

TEST_F(StoreTest, RefusesWhatIsNoStoreAndLeavesItAlone) {
  const std::string text = "update,reward\n1,0.5\n";
  make_file(path_, text);
  EXPECT_TRUE(contains(refusal(), "is not a store of the dashboard"));
  EXPECT_EQ(contents(path_), text);

  std::filesystem::remove(path_);
  open_database(path_, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec("CREATE TABLE friends (name TEXT)");
  const std::string foreign = contents(path_);
  EXPECT_TRUE(contains(refusal(), "is an SQLite file of another program"));
  EXPECT_EQ(contents(path_), foreign);

  std::filesystem::remove(path_);
  std::filesystem::create_directory(path_);
  EXPECT_TRUE(contains(refusal(), "is not a regular file"));
  EXPECT_TRUE(contains(refusal(), path_));
}

TEST_F(StoreTest, RefusesANewerSchemaAndLeavesItAlone) {
  { Store store(options()); }
  open_database(path_, SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 99");
  const std::string before = contents(path_);
  EXPECT_TRUE(contains(refusal(), "has schema 99, this dashboard knows"));
  EXPECT_EQ(contents(path_), before);
}

TEST_F(StoreTest, RefusesADamagedFileAndLeavesItAlone) {
  {
    Store store(options());
    store.record(episodes(1, 2000));
  }
  std::string bytes = contents(path_);
  ASSERT_GT(bytes.size(), 100000u);
  for (std::size_t i = bytes.size() / 2; i < bytes.size() / 2 + 20000; ++i) bytes[i] = static_cast<char>(i * 7);
  make_file(path_, bytes);
  EXPECT_TRUE(contains(refusal(), "damaged"));
  EXPECT_TRUE(contains(refusal(), "restore a copy"));
  EXPECT_EQ(contents(path_), bytes);
  bytes.resize(5000);
  make_file(path_, bytes);
  EXPECT_NE(refusal(), "");
  EXPECT_EQ(contents(path_), bytes);
}

TEST_F(StoreTest, KeepsAnOlderFileAsideAndBeginsANewOne) {
  const auto older = [&] {
    Store(options()).record(episodes(1, 3));
    open_database(path_, SQLite::OPEN_READWRITE).exec("PRAGMA user_version = 8");
  };
  older();
  EXPECT_EQ(Store(options()).recorded_up_to(kEnvironment), 0u);
  SQLite::Database aside = open_database(path_ + ".schema-8");
  EXPECT_EQ(aside.execAndGet("SELECT COUNT(*) FROM episodes").getInt64(), 3);

  std::filesystem::remove(path_);
  older();
  EXPECT_TRUE(contains(refusal(), path_ + ".schema-8 exists"));
  EXPECT_EQ(number("SELECT COUNT(*) FROM episodes"), 3) << "neither is lost";
}

TEST_F(StoreTest, AddsTheColumnOfAFigureThatIsNewerThanTheFile) {
  { const Store store(options()); }
  open_database(path_, SQLite::OPEN_READWRITE).exec("ALTER TABLE training DROP COLUMN entropy");
  const Store store(options());
  EXPECT_EQ(number("SELECT COUNT(*) FROM pragma_table_info('training') WHERE name = 'entropy'"), 1);
}

}  // namespace
}  // namespace citylearn::testing
