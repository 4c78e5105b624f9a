// SPDX-License-Identifier: Apache-2.0
// Ranks over DDS and gloo on loopback, each in a thread; a rank is killed by closing all that it has open.
#include "policy_service/ranks/gloo_group.h"

#include <gtest/gtest.h>

#include <atomic>
#include <map>
#include <mutex>
#include <thread>

#include "core/wire/node.h"
#include "policy_service/ranks/shared_updates.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"

namespace citylearn::testing {
namespace {

struct Killed {};

/// The place where a rank is killed next.
enum Place { kNowhere, kAnywhere, kBeforeMeeting, kBeforeSum, kBeforeVote, kWhileVoting };

/// A group whose owner may die at given places.
class Mortal : public RankGroup {
 public:
  Mortal(const RankOptions& options, std::atomic<int>& death)
      : death_(death), group_(options, [this] { die(voting_ ? kWhileVoting : kAnywhere); }) {}
  RankMeeting meet(const RankArrival& arrival) override {
    voting_ = false;
    die(kBeforeMeeting);
    return group_.meet(arrival);
  }
  void sum(std::span<float> values) override {
    die(kBeforeSum);
    group_.sum(values);
  }
  bool agree(bool succeeded) override {
    die(kBeforeVote);
    voting_ = true;
    if (death_ == kWhileVoting) {
      // It has voted as soon as it waits.
      return group_.agree(succeeded), throw Killed(), false;
    }
    return group_.agree(succeeded);
  }
  void leave() override { group_.leave(); }

 private:
  void die(int place) const {
    if (death_ == place || death_ == kAnywhere) throw Killed();
  }
  std::atomic<int>& death_;
  std::atomic<bool> voting_ = false;
  GlooGroup group_;
};

/// The results that all ranks saw after each update.
struct Record {
  std::mutex mutex;
  std::map<std::uint64_t, std::pair<std::uint64_t, Vector<float>>> updates;  ///< number: steps and parameters
};

/// One rank that learns: each update is one step, and moves its parameters by its number.
class Rank {
 public:
  Rank(Record& record, RankOptions options)
      : record_(record), options_(std::move(options)), thread_([this] { run(); }) {}
  ~Rank() {
    death = kAnywhere;
    thread_.join();
  }
  bool reaches(std::uint64_t wanted, milliseconds patience = seconds(20)) const {
    return poll_until([&] { return updates >= wanted; }, patience);
  }
  void wait() {
    EXPECT_TRUE(poll_until([&] { return over.load(); }, seconds(20)));
  }

  std::atomic<int> death = kNowhere;
  std::atomic<std::uint64_t> updates = 0;
  std::atomic<int> members = 0;
  std::atomic<bool> over = false;
  std::string error;

 private:
  void run() {
    try {
      Mortal group(options_, death);
      SharedUpdates sharing(group);
      LearnerState state;
      state.counters = {{"steps", 0}, {"updates", 0}};
      state.tensors["parameters"] = Vector<float>::Zero(3000);
      LocalUpdate mine;
      while (true) {
        mine.updates = updates;
        mine.progress = std::to_string(updates);
        const SharedUpdate shared = sharing.share(
            mine, [](GradientSharing*, LearnerState&) {}, state);
        std::uint64_t now = shared.progress ? std::stoull(*shared.progress) : updates.load();
        if (shared.steps > 0) ++now;
        {
          const std::lock_guard lock(record_.mutex);
          const auto seen = std::pair(state.counters["steps"], state.tensors["parameters"]);
          EXPECT_TRUE(record_.updates.emplace(now, seen).first->second == seen)
              << "all ranks have the same update " << now;
        }
        members = sharing.members();
        updates = now;
        ::poll(nullptr, 0, 2);  // what learning takes: ranks that only exchange leave no processor to the others
        mine.steps = 1;
        state.tensors["parameters"].array() += static_cast<float>(options_.rank + 1);
        ++state.counters["steps"];
        state.counters["updates"] = now;
      }
    } catch (const Killed&) {
    } catch (const std::exception& problem) {
      error = problem.what();
    }
    over = true;
  }

  Record& record_;
  const RankOptions options_;
  std::thread thread_;
};

class Ranks : public ::testing::Test {
 protected:
  RankOptions options(int rank, int ranks) const {
    RankOptions options;
    options.rank = rank;
    options.ranks = ranks;
    options.node.id = "policy";
    options.node.middleware.domain = domain_;
    options.identity = R"({"training": {"trainer": {"steps": 4096}}, "lockstep": false})";
    return options;
  }
  std::unique_ptr<Rank> start(int rank, int ranks) { return std::make_unique<Rank>(record_, options(rank, ranks)); }

  const std::uint32_t domain_ = own_domain();
  Record record_;
};

TEST_F(Ranks, LearnTogether) {
  const auto two = start(2, 3), zero = start(0, 3), one = start(1, 3);
  for (const auto* rank : {&zero, &one, &two}) ASSERT_TRUE((*rank)->reaches(20)) << (*rank)->error;
  const std::lock_guard lock(record_.mutex);
  EXPECT_EQ(record_.updates.at(20).first, 3 * 20u);
  EXPECT_NEAR(record_.updates.at(20).second.mean(), 20 * 2.0, 1e-3) << "the mean of 1, 2 and 3";
}

TEST_F(Ranks, GoOnWithinThreeSecondsWithoutAKilledOneWhichComesBack) {
  constexpr int kRanks = 3;
  std::vector<std::unique_ptr<Rank>> ranks;
  for (int rank = 0; rank < kRanks; ++rank) ranks.push_back(start(rank, kRanks));
  ASSERT_TRUE(ranks[0]->reaches(3)) << ranks[0]->error;
  for (const auto& [place, killed] : {std::pair{kAnywhere, 0},
                                      {kBeforeMeeting, 1},
                                      {kBeforeSum, 2},
                                      {kBeforeVote, 1},
                                      {kWhileVoting, 0},
                                      {kWhileVoting, 2}}) {
    ranks[static_cast<std::size_t>(killed)]->death = place;
    ranks[static_cast<std::size_t>(killed)]->wait();
    const Clock::time_point since = Clock::now();
    for (int other = 0; other < kRanks; ++other) {
      if (other == killed) continue;
      const auto& rank = ranks[static_cast<std::size_t>(other)];
      ASSERT_TRUE(poll_until([&] { return rank->members == kRanks - 1; }, seconds(3)))
          << "rank " << other << " after a kill of " << killed << " at " << place << " " << rank->error;
      ASSERT_TRUE(rank->reaches(rank->updates + 2, seconds(3))) << other << " " << rank->error;
    }
    EXPECT_LT(seconds_since(since), 3.0 * kSlowness);
    ranks[static_cast<std::size_t>(killed)] = start(killed, kRanks);
    for (const auto& rank : ranks)
      ASSERT_TRUE(poll_until([&] { return rank->members == kRanks; }, seconds(20)))
          << "after a kill of " << killed << " at " << place << ": " << rank->error;
  }
}

TEST_F(Ranks, GoOnWhateverStrangersSay) {
  const auto zero = start(0, 2), one = start(1, 2);
  ASSERT_TRUE(zero->reaches(2)) << zero->error;
  NodeOptions options{{}, "stranger", "rank-1", "ranks"};
  options.middleware.domain = domain_;
  Node stranger(options);
  stranger.create_reader<msg::RankStatus>();
  msg::RankStatus heard;
  for (std::uint32_t rank : {0u, 1u, 7u, 4000000000u}) {
    ASSERT_TRUE(poll_until([&] { return stranger.wait(Clock::now() + milliseconds(50)) && stranger.take(heard); },
                           seconds(20)));
    msg::RankStatus claim = heard;
    claim.rank(rank);
    if (rank > 1) claim.ranks(4000000000u);
    claim.coordinator(stranger.incarnation());
    claim.history(1);
    claim.call(1);
    claim.call_number(1000000);
    claim.members().assign(msg::MAX_RANKS, heard.header().incarnation());
    claim.member_rank().assign(msg::MAX_RANKS, 0);
    claim.member_updates().assign(msg::MAX_RANKS, 1000000);
    claim.newcomer().assign(msg::MAX_RANKS, 0);
    claim.hears().assign(msg::MAX_RANKS, heard.header().incarnation());
    for (int again = 0; again < 20; ++again) stranger.publish(claim);
    const std::uint64_t before = one->updates;
    ASSERT_TRUE(one->reaches(before + 20, seconds(3))) << one->error << zero->error;
    EXPECT_EQ(one->members, 2);
  }
}

}  // namespace
}  // namespace citylearn::testing
