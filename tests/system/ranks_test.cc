// SPDX-License-Identifier: Apache-2.0
// Learners that share the work: policy_services as ranks, each with an env_service in a DDS domain of its own.
#include <gtest/gtest.h>

#include <map>
#include <nlohmann/json.hpp>

#include "core/util/machine.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/episodes_csv.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using Strings = std::vector<std::string>;

/// A rank: its cell, its env_service, its policy_service.
class Rank {
 public:
  Rank(std::uint32_t meeting, int rank, int ranks)
      : meeting_(meeting), rank_(rank), ranks_(ranks), env_(trial.env("summer")) {}

  /// Starts its policy_service, again too.
  void start(int updates, Arguments more = {}) {
    policy_.reset();
    more.insert(more.end(), {"--ranks-domain", std::to_string(meeting_), "--rank", std::to_string(rank_), "--ranks",
                             std::to_string(ranks_), "--seed", "5"});
    policy_ = trial.train(updates, "out", more);
  }
  Service& policy() { return *policy_; }
  std::vector<Strings> metrics() const { return csv_rows(trial.folder() / "out/metrics.csv"); }
  int updates() const {
    const auto rows = metrics();
    return rows.empty() ? 0 : std::stoi(rows.back().at(0));
  }
  bool reaches(int wanted, milliseconds patience = kLongWait) const {
    return poll_until([&] { return updates() >= wanted; }, patience);
  }

  Trial trial{"cyclonedds"};

 private:
  const std::uint32_t meeting_;
  const int rank_, ranks_;
  std::unique_ptr<Service> env_, policy_;
};

/// So many ranks that meet on loopback.
class Group {
 public:
  explicit Group(int ranks) {
    for (int rank = 0; rank < ranks; ++rank) ranks_.push_back(std::make_unique<Rank>(meeting, rank, ranks));
  }
  Rank& operator[](int rank) { return *ranks_.at(static_cast<std::size_t>(rank)); }
  int size() const { return static_cast<int>(ranks_.size()); }
  void start(int updates, const Arguments& more = {}) {
    for (const auto& rank : ranks_) rank->start(updates, more);
  }
  /// Every update is on record once, the same in all ranks, and learned from at most `steps` steps of each rank.
  void expect_same_updates(int steps = 512) const {
    std::map<int, std::string> known;
    for (const auto& rank : ranks_) {
      int before = 0;
      long steps_before = 0;
      for (const Strings& row : rank->metrics()) {
        const int update = std::stoi(row.at(0));
        EXPECT_GT(update, before);
        EXPECT_EQ(known.emplace(update, row.at(1)).first->second, row.at(1)) << "steps after update " << update;
        const long all = std::stol(row.at(1));
        if (update == before + 1 && before > 0) {
          EXPECT_EQ((all - steps_before) % steps, 0);
          EXPECT_LE(all - steps_before, steps * size());
        }
        before = update;
        steps_before = all;
      }
    }
  }

  const std::uint32_t meeting = own_domain();

 private:
  std::vector<std::unique_ptr<Rank>> ranks_;
};

class Sync : public ::testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(, Sync, ::testing::Values("update", "step"),
                         [](const auto& tested) { return std::string(tested.param); });

TEST_P(Sync, FixedRanksInLockstepLearnTheSameBytesTwice) {
  std::string bytes[2];
  for (std::string& found : bytes) {
    Group group(2);
    group.start(40, {"--lockstep", "--sync", GetParam()});
    for (const int rank : {0, 1}) ASSERT_EQ(group[rank].policy().wait(kLongWait), 0) << group[rank].policy().output();
    found = group[0].trial.checkpoint("out").second;
    EXPECT_EQ(group[1].trial.checkpoint("out").first, "") << "the lowest rank alone writes checkpoints";
    EXPECT_EQ(group[0].metrics().back().at(1), std::to_string(40 * 512)) << "all steps count";
    EXPECT_EQ(group[0].updates(), 20);
    group.expect_same_updates();
    const Json manifest = Json::parse(contents(group[0].trial.folder() / "out/manifest.json"));
    EXPECT_EQ(manifest["ranks"], 2);
  }
  ASSERT_FALSE(bytes[0].empty());
  EXPECT_TRUE(bytes[0] == bytes[1]);
}

TEST_P(Sync, TheOthersGoOnWithinThreeSecondsWhenOneIsKilledOrStopped) {
  Group group(3);
  group.start(1000000, {"--sync", GetParam()});
  for (int rank = 0; rank < 3; ++rank) ASSERT_TRUE(group[rank].reaches(3)) << group[rank].policy().output();
  for (const int signal : {SIGKILL, SIGSTOP})
    for (int lost = 0; lost < 3; ++lost) {
      group[lost].policy().send(signal);
      if (signal == SIGKILL) group[lost].policy().wait(seconds(5));
      const Clock::time_point since = Clock::now();
      for (int other = 0; other < 3; ++other) {
        if (other == lost) continue;
        const int before = group[other].updates();
        ASSERT_TRUE(group[other].reaches(before + 2, seconds(6)))
            << "rank " << other << " without " << lost << ": " << group[other].policy().output();
      }
      std::printf("signal %d to rank %d: the others made two updates within %.2f s\n", signal, lost,
                  seconds_since(since));
      EXPECT_LT(seconds_since(since), 4.0 * kSlowness);
      if (signal == SIGKILL)
        group[lost].start(1000000, {"--resume", "--sync", GetParam()});
      else
        group[lost].policy().send(SIGCONT);
      const int before = group[lost == 0 ? 1 : 0].updates();
      ASSERT_TRUE(group[lost].reaches(before + 2)) << "it comes back: " << group[lost].policy().output();
    }
  for (int rank = 0; rank < 3; ++rank) group[rank].policy().end(SIGTERM, seconds(5));
  group.expect_same_updates();
  if (HasFailure())
    for (int rank = 0; rank < 3; ++rank) std::printf("rank %d:\n%s\n", rank, group[rank].policy().output().c_str());
}

TEST(RanksSystem, StopTogetherAtTheirSplAndTheLowestKeepsTheBest) {
  Group group(2);
  group.start(1000000, {"--stop-when", "0.9"});
  for (const int rank : {0, 1}) ASSERT_EQ(group[rank].policy().wait(kLongWait), 0) << group[rank].policy().output();
  EXPECT_EQ(group[0].updates(), group[1].updates());
  const std::string best = "out/checkpoints/best.clk";
  EXPECT_TRUE(std::filesystem::exists(group[0].trial.folder() / best));
  EXPECT_FALSE(std::filesystem::exists(group[1].trial.folder() / best));
}

TEST(RanksSystem, GoesOnWithAnotherNumberOfRanks) {
  Group two(2);
  two.start(60, {"--lockstep"});
  for (const int rank : {0, 1}) ASSERT_EQ(two[rank].policy().wait(kLongWait), 0) << two[rank].policy().output();
  Group three(3);
  std::filesystem::copy(two[0].trial.folder() / "out", three[0].trial.folder() / "out",
                        std::filesystem::copy_options::recursive);
  std::filesystem::remove(three[0].trial.folder() / "out/checkpoints/" + two[0].trial.checkpoint("out").first);
  three.start(60, {"--lockstep", "--resume"});
  for (int rank = 0; rank < 3; ++rank)
    ASSERT_EQ(three[rank].policy().wait(kLongWait), 0) << three[rank].policy().output();
  EXPECT_TRUE(contains(three[0].policy().output(), "resuming after update 20"));
  const Json manifest = Json::parse(contents(three[0].trial.folder() / "out/manifest.json"));
  EXPECT_EQ(manifest["ranks"], 3);
  EXPECT_EQ(manifest["ranks_before"].size(), 1u) << manifest.dump(1);
  for (int rank = 0; rank < 3; ++rank) EXPECT_EQ(three[rank].metrics().back().at(1), std::to_string(61 * 512));
}

TEST(RanksSystem, WrongRanksAreOneClearLine) {
  Group group(2);
  const std::string at = std::to_string(group.meeting);
  Trial& trial = group[0].trial;
  const WrongInputs cases = {
      {"out of range", {{"--ranks-domain", at, "--ranks", "2", "--rank", "2"}, "--rank: is 2, must be 0 to 1"}},
      {"below 0", {{"--ranks-domain", at, "--ranks", "2", "--rank", "-1"}, "--rank"}},
      {"no rank", {{"--ranks-domain", at, "--ranks", "2"}, "--rank: is missing"}},
      {"no number of ranks", {{"--ranks-domain", at, "--rank", "1"}, "--ranks: is missing"}},
      {"no domain", {{"--ranks", "2", "--rank", "1"}, "--ranks: needs --ranks-domain"}},
      {"an evaluation", {{"--mode", "evaluate", "--ranks-domain", at}, "--ranks-domain: is for what learns"}},
      {"security", {{"--ranks-domain", at, "--ranks", "2", "--rank", "1", "--security", "keys"}, "--unprotected-sums"}},
      {"others that do not come",
       {{"--ranks-domain", at, "--ranks", "2", "--rank", "1", "--ranks-wait", "2"},
        "of 2 ranks, these did not come within 2 s: 0"}},
  };
  expect_one_clear_line(trial, cases, seconds(12));
  group[0].start(1000000);
  ASSERT_TRUE(group[0].policy().says("waits for the others", kLongWait)) << "of two that differ the later one ends";
  group[1].start(1000000, {"--ppo-gamma", "0.5"});
  ASSERT_EQ(group[1].policy().wait(seconds(30)), 1) << group[1].policy().output();
  EXPECT_TRUE(contains(group[1].policy().output(), "rank 1: training.learner_parameters.gamma is 0.5, that of"))
      << group[1].policy().output();
  group[1].start(1000000, {"--overwrite"});
  ASSERT_TRUE(group[1].reaches(2)) << group[1].policy().output();
  Rank twin(group.meeting, 1, 2);
  twin.start(1000000);
  ASSERT_EQ(twin.policy().wait(seconds(30)), 1) << twin.policy().output();
  EXPECT_TRUE(contains(twin.policy().output(), "rank 1: a living process, on " + host_name() + ","))
      << twin.policy().output();
}

}  // namespace
}  // namespace citylearn::testing
