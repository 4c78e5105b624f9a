// SPDX-License-Identifier: Apache-2.0
// Ranks over DDS and gloo on loopback, each in a thread.
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

struct Ended {};

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
    ended_ = true;
    thread_.join();
  }
  bool reaches(std::uint64_t wanted, milliseconds patience = seconds(20)) const {
    return poll_until([&] { return updates >= wanted; }, patience);
  }

  std::atomic<std::uint64_t> updates = 0;
  std::atomic<int> members = 0;
  std::string error;

 private:
  void run() {
    try {
      GlooGroup group(options_, [this] {
        if (ended_) throw Ended();
      });
      SharedUpdates sharing(group);
      LearnerState state;
      state.counters = {{"steps", 0}, {"updates", 0}};
      state.tensors["parameters"] = Vector<float>::Zero(3000);
      LocalUpdate mine;
      while (!ended_) {
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
    } catch (const Ended&) {
    } catch (const std::exception& problem) {
      error = problem.what();
    }
  }

  Record& record_;
  const RankOptions options_;
  std::atomic<bool> ended_ = false;
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
