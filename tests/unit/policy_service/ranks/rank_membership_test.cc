// SPDX-License-Identifier: Apache-2.0
// Histories of ranks that are killed, stand still and are cut off from each other, while their statuses are lost, come
// twice or late, and strangers send some. The class that decides is the real one. The network, the clock, the learners
// and, as to its outcome, gloo are a model.
#include "policy_service/ranks/rank_membership.h"

#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <functional>
#include <memory>
#include <random>
#include <sstream>

#include "core/exchange/timing.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

constexpr const char* kIdentity = R"({"trainer": {"steps": 4096}, "lockstep": false})";

/// The faults of a world.
struct Weather {
  int ranks = 3;
  double lost = 0, repeated = 0, late = 0;  ///< shares of the statuses
  bool cuts = false, pauses = false, strangers = false;
};

struct Learner;

struct World {
  World(std::uint64_t seed, const Weather& weather_now) : random(seed), weather(weather_now) {
    for (int rank = 0; rank < weather.ranks; ++rank) after(pick(0, 300), [this, rank] { start(rank); });
  }
  int pick(int low, int high) { return std::uniform_int_distribution<int>(low, high)(random); }
  bool chance(double share) { return std::uniform_real_distribution<double>()(random) < share; }
  void after(int delay, std::function<void()> event) { events[{now + delay, events_made++}] = std::move(event); }
  Clock::time_point time() const {
    return Clock::time_point(std::chrono::seconds(1000) + std::chrono::milliseconds(now));
  }
  void check(bool holds, const std::string& otherwise) {
    if (!holds && fault.empty()) fault = std::to_string(now) + " ms: " + otherwise;
  }
  void run_until(int end) {
    while (fault.empty() && !events.empty() && events.begin()->first.first <= end) {
      const auto next = events.extract(events.begin());
      now = next.key().first;
      next.mapped()();
    }
    now = end;
  }
  bool run_until(const std::function<bool()>& holds, int patience) {
    for (const int end = now + patience; now < end && fault.empty() && !holds();) run_until(now + 10);
    return holds();
  }

  void start(int rank);
  void kill(int rank);
  void deliver(const Learner& from, const std::shared_ptr<const msg::RankStatus>& status);
  void insult();
  Learner& of(int rank) { return *learners.at(static_cast<std::size_t>(last_of.at(rank))); }
  Learner* by_incarnation(std::uint64_t incarnation) {
    return incarnation >= 100 && incarnation < 100 + learners.size() ? learners[incarnation - 100].get() : nullptr;
  }
  bool is_cut(int from, int to) const { return cut.contains({from, to}); }
  int add(int before, const std::vector<int>& works);
  bool together() const;

  struct Update {
    int before = 0, count = 0;
    std::vector<int> works;
  };
  std::mt19937_64 random;
  Weather weather;
  int now = 0, works = 0, lost_works = 0;
  std::uint64_t events_made = 0;
  std::map<std::pair<int, std::uint64_t>, std::function<void()>> events;
  std::vector<std::unique_ptr<Learner>> learners;  ///< all processes; that of place i has the incarnation 100 + i
  std::map<int, int> last_of;                      ///< the newest process of each rank
  std::set<std::pair<int, int>> cut;               ///< ranks from which none comes to others
  std::vector<Update> updates{1};                  ///< 0: none
  std::map<std::pair<int, std::vector<int>>, int> known_updates;
  std::map<std::uint64_t, int> named;                            ///< updates, by RankStatus.history
  std::map<int, std::shared_ptr<const msg::RankStatus>> newest;  ///< statuses, by rank
  std::string fault, log;
};

/// One process of a rank. Its work is a number that stands for the steps that it learned from.
struct Learner {
  Learner(World& all, int own_rank, int own_place)
      : world(all),
        rank(own_rank),
        place(own_place),
        membership({own_rank, all.weather.ranks, "host", kIdentity}, incarnation(), all.time()) {
    learn();
    turn();
  }
  std::uint64_t incarnation() const { return 100 + static_cast<std::uint64_t>(place); }
  std::string name() const { return "process " + std::to_string(place) + " of rank " + std::to_string(rank); }
  void later(int delay, std::function<void()> event) {
    world.after(delay, [this, event = std::move(event)]() mutable {
      if (paused)
        waiting.push_back(std::move(event));
      else if (alive)
        event();
    });
  }

  void learn() {
    work = world.works++;
    later(world.pick(20, 80), [this] { arrive(); });
  }
  void arrive() {
    membership.arrive(static_cast<std::uint64_t>(world.updates[static_cast<std::size_t>(history)].count), 0);
    called = false;
    step();
  }
  /// Adds: that begins when all are there, and fails where one is not, or is cut off.
  void add(int deadline) {
    bool all = true, any_lost = false;
    for (const RankCall::Member& one : membership.call()->members) {
      const Learner* const other = world.by_incarnation(one.incarnation);
      if (!other) return vote(false);
      any_lost |= !other->alive || world.is_cut(rank, one.rank) || world.is_cut(one.rank, rank);
      all &= other->membership.status().taken() == membership.status().taken();
    }
    if (any_lost || world.now > deadline) return later(any_lost ? world.pick(1, 1500) : 0, [this] { vote(false); });
    if (!all) return later(3, [this, deadline] { add(deadline); });
    later(world.pick(5, 40), [this] { vote(!lacks_any()); });
  }
  bool lacks_any() const {
    const auto& members = membership.call()->members;
    return std::any_of(members.begin(), members.end(), [this](const RankCall::Member& one) {
      return !world.by_incarnation(one.incarnation)->alive || world.is_cut(rank, one.rank) ||
             world.is_cut(one.rank, rank);
    });
  }
  void vote(bool yes) {
    has_sum = yes;
    membership.vote(yes);
    step();
  }
  void decided(bool yes) {
    if (!yes) return later(1, [this] { arrive(); });  // with the same work
    world.check(has_sum, "an update counts whose sum " + name() + " does not have");
    std::vector<int> works;
    int before = -1;
    bool newcomer = false;
    for (const RankCall::Member& one : membership.call()->members) {
      const auto& [its_work, its_history] = world.by_incarnation(one.incarnation)->offered.at(membership.call()->id);
      newcomer |= one.newcomer && one.incarnation == incarnation();
      if (one.newcomer) continue;
      works.push_back(its_work);
      world.check(before < 0 || before == its_history, "members with other histories are added");
      before = its_history;
    }
    if (newcomer && world.updates[static_cast<std::size_t>(history)].count > 0) ++world.lost_works;
    history = world.add(before, works);
    world.check(world.named.emplace(membership.status().history(), history).first->second == history,
                "two updates have one name");
    together = works.size();
    last_members = membership.call()->members;
    world.log += std::to_string(world.now) + " " + std::to_string(place) + " " + std::to_string(history) + "\n";
    learn();
  }

  void receive(const msg::RankStatus& status) {
    membership.take(status, world.time());
    step();
  }
  void turn() {
    step();
    later(50, [this] { turn(); });
  }
  void step() {
    membership.tick(world.time());
    if (membership.status().phase() == msg::ADDING && !std::exchange(called, true)) {
      offered[membership.call()->id] = {work, history};
      add(world.now + static_cast<int>(kGlooReceive.count()));
    } else if (called && membership.decision() && membership.status().phase() == msg::LEARNING) {
      called = false;
      decided(*membership.decision());
    }
    msg::RankStatus now = membership.status();
    const bool waits = now.phase() != msg::LEARNING;
    now.header(sent.header());
    if (now == sent && world.now < next) return;
    sent = now;
    next = world.now + static_cast<int>(waits ? kRankRepeat.count() : kRankHeartbeat.count());
    now.header().incarnation(incarnation());
    now.header().message(++messages);
    world.deliver(*this, std::make_shared<const msg::RankStatus>(now));
  }

  World& world;
  const int rank, place;
  bool alive = true, paused = false, called = false, has_sum = false;
  int work = 0, history = 0, next = 0;
  std::size_t together = 0;
  std::map<std::uint64_t, std::pair<int, int>> offered;  ///< work and history, by call
  std::vector<RankCall::Member> last_members;
  std::vector<std::function<void()>> waiting;
  std::uint64_t messages = 0;
  msg::RankStatus sent;
  RankMembership membership;
};

void World::start(int rank) {
  last_of[rank] = static_cast<int>(learners.size());
  learners.push_back(nullptr);
  learners.back() = std::make_unique<Learner>(*this, rank, last_of[rank]);
}

void World::kill(int rank) {
  of(rank).alive = false;
  after(pick(100, 1500), [this, rank] { start(rank); });
}

void World::deliver(const Learner& from, const std::shared_ptr<const msg::RankStatus>& status) {
  newest[from.rank] = status;
  for (const auto& [rank, place] : last_of) {
    if (rank == from.rank || is_cut(from.rank, rank) || chance(weather.lost)) continue;
    for (int copies = chance(weather.repeated) ? 2 : 1; copies > 0; --copies)
      after(chance(weather.late) ? pick(30, 1000) : pick(1, 20), [this, place = place, status] {
        Learner* const to = learners[static_cast<std::size_t>(place)].get();
        if (!to || !to->alive) return;
        to->later(0, [to, status] { to->receive(*status); });
      });
  }
}

/// A stranger sends a status in the name of a rank, and claims what it can.
void World::insult() {
  if (newest.empty()) return;
  msg::RankStatus status = *std::next(newest.begin(), pick(0, static_cast<int>(newest.size()) - 1))->second;
  status.header().incarnation(static_cast<std::uint64_t>(pick(1, 99)));
  status.header().message(static_cast<std::uint64_t>(pick(1, 1000000)));
  if (chance(0.3)) status.rank(static_cast<std::uint32_t>(pick(0, 2000000)));
  if (chance(0.3)) status.ranks(1000000);
  if (chance(0.3)) status.identity(7);
  status.coordinator(status.header().incarnation());
  status.history(chance(0.5) ? 1 : status.history());
  status.call(5);
  status.call_number(1000000000);
  status.members().assign(1000, 100);
  status.member_rank().assign(1000, 0);
  status.member_updates().assign(1000, 1000000);
  status.newcomer().assign(1000, 0);
  status.verdict(status.taken());
  status.counts(chance(0.5));
  for (std::uint64_t one = 100; one < 100 + learners.size(); ++one) status.hears().push_back(one);
  for (const auto& learner : learners)
    if (learner && learner->alive && !learner->paused) learner->receive(status);
}

int World::add(int before, const std::vector<int>& content) {
  const auto [found, is_new] = known_updates.try_emplace({before, content}, static_cast<int>(updates.size()));
  if (!is_new) return found->second;
  for (int earlier = before; earlier > 0; earlier = updates[static_cast<std::size_t>(earlier)].before)
    for (const int one : updates[static_cast<std::size_t>(earlier)].works)
      check(!std::count(content.begin(), content.end(), one), "work " + std::to_string(one) + " counts twice");
  updates.push_back({before, updates[static_cast<std::size_t>(before)].count + 1, content});
  return found->second;
}

/// Returns whether all ranks made their last update together.
bool World::together() const {
  if (last_of.size() < static_cast<std::size_t>(weather.ranks)) return false;
  return std::all_of(last_of.begin(), last_of.end(), [&](const auto& entry) {
    const Learner& one = *learners[static_cast<std::size_t>(entry.second)];
    return one.alive && !one.paused && one.together == static_cast<std::size_t>(weather.ranks) &&
           std::all_of(one.last_members.begin(), one.last_members.end(),
                       [&](const RankCall::Member& member) { return learners[member.incarnation - 100]->alive; });
  });
}

class RankMembershipTest : public ::testing::Test {
 protected:
  RankMembershipTest() { spdlog::set_level(spdlog::level::off); }
  ~RankMembershipTest() override { spdlog::set_level(level_); }

 private:
  const spdlog::level::level_enum level_ = spdlog::get_level();
};

TEST_F(RankMembershipTest, TheOthersGoOnWithinThreeSecondsAfterAKillAndLoseNoWork) {
  std::vector<int> waited;
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    World world(seed, {.ranks = 2 + static_cast<int>(seed % 4)});
    ASSERT_TRUE(world.run_until([&] { return world.together(); }, 5000)) << "seed " << seed << " " << world.fault;
    for (int kills = 0; kills < 8 && world.fault.empty(); ++kills) {
      world.run_until(world.now + world.pick(0, 400));
      std::set<int> killed = {world.pick(0, world.weather.ranks - 1)};
      world.kill(*killed.begin());
      if (world.weather.ranks > 2 && world.chance(0.4)) {  // another one, perhaps before the others have gone on
        world.run_until(world.now + world.pick(0, 2000));
        const int other = world.pick(0, world.weather.ranks - 1);
        if (!killed.contains(other) && world.of(other).alive) {
          killed.insert(other);
          world.kill(other);
        }
      }
      const int since = world.now;
      const auto goes_on = [&] {
        return std::all_of(world.last_of.begin(), world.last_of.end(), [&](const auto& entry) {
          const Learner& one = world.of(entry.first);
          return killed.contains(entry.first) ||
                 (!one.last_members.empty() &&
                  std::all_of(one.last_members.begin(), one.last_members.end(), [&](const RankCall::Member& member) {
                    return world.by_incarnation(member.incarnation)->alive;
                  }));
        });
      };
      EXPECT_TRUE(world.run_until(goes_on, 3000)) << "seed " << seed << " at " << world.now << " " << world.fault;
      waited.push_back(world.now - since);
      ASSERT_TRUE(world.run_until([&] { return world.together(); }, 10000)) << "seed " << seed << " " << world.fault;
    }
    EXPECT_EQ(world.fault, "") << "seed " << seed;
    EXPECT_EQ(world.lost_works, 0) << "seed " << seed;
  }
  std::sort(waited.begin(), waited.end());
  std::printf("the others went on after %d ms (median), %d ms (95 of 100), %d ms (most)\n", waited[waited.size() / 2],
              waited[waited.size() * 95 / 100], waited.back());
}

TEST_F(RankMembershipTest, NothingCountsTwiceHoweverStatusesTravel) {
  for (std::uint64_t seed = 1; seed <= 120; ++seed) {
    World world(seed, {.ranks = 2 + static_cast<int>(seed % 4), .lost = 0.2, .repeated = 0.1, .late = 0.05});
    world.run_until(2000);
    for (int faults = 0; faults < 25 && world.fault.empty(); ++faults) {
      world.run_until(world.now + world.pick(0, 900));
      const int one = world.pick(0, world.weather.ranks - 1), other = world.pick(0, world.weather.ranks - 1);
      switch (world.pick(0, 5)) {
        case 0:
          if (world.of(one).alive) world.kill(one);
          break;
        case 1: {
          Learner* const paused = &world.of(one);
          paused->paused = true;
          world.after(world.pick(100, 4000), [paused] {
            paused->paused = false;
            for (const auto& event : std::exchange(paused->waiting, {}))
              if (paused->alive) event();
          });
          break;
        }
        case 2:  // one way
          world.cut.insert({one, other});
          break;
        case 3:  // two sides
          for (int a = 0; a < world.weather.ranks; ++a)
            for (int b = 0; b < world.weather.ranks; ++b)
              if ((a <= one) != (b <= one)) world.cut.insert({a, b});
          break;
        default:
          world.cut.clear();
      }
      world.insult();
    }
    world.cut.clear();
    world.weather = {.ranks = world.weather.ranks};
    EXPECT_TRUE(world.run_until([&] { return world.together(); }, 15000)) << "seed " << seed << " " << world.fault;
    EXPECT_EQ(world.fault, "") << "seed " << seed;
  }
}

TEST_F(RankMembershipTest, OneThatStoodStillCountsNoUpdateThatTheOthersMadeAnew) {
  for (std::uint64_t seed = 1; seed <= 200; ++seed) {
    World world(seed, {});
    for (int pauses = 0; pauses < 8 && world.fault.empty(); ++pauses) {
      ASSERT_TRUE(world.run_until([&] { return world.together(); }, 10000)) << "seed " << seed << " " << world.fault;
      world.run_until(world.now + world.pick(0, 200));
      Learner& one = world.of(world.pick(0, 2));
      one.paused = true;
      world.run_until(world.now + world.pick(1600, 4000));
      one.paused = false;
      // What came meanwhile is read one after another, the oldest first.
      int delay = 0;
      for (auto& event : std::exchange(one.waiting, {})) one.later(++delay / 4, std::move(event));
    }
    EXPECT_EQ(world.fault, "") << "seed " << seed;
    std::map<int, int> numbered;
    std::istringstream log(world.log);
    for (int time = 0, place = 0, update = 0; log >> time >> place >> update;) {
      const int number = world.updates[static_cast<std::size_t>(update)].count;
      EXPECT_EQ(numbered.emplace(number, update).first->second, update)
          << "number " << number << " of process " << place << " at " << time << " ms, seed " << seed;
    }
  }
}

TEST_F(RankMembershipTest, WhatHappensDependsOnTheSeedAlone) {
  std::string logs[2];
  for (std::string& log : logs) {
    World world(5, {.ranks = 4, .lost = 0.1, .late = 0.1});
    world.run_until(3000);
    world.kill(0);
    world.run_until(8000);
    log = world.log;
  }
  EXPECT_FALSE(logs[0].empty());
  EXPECT_EQ(logs[0], logs[1]);
}

/// A rank among others whose statuses the test writes.
class OneRank : public RankMembershipTest {
 protected:
  /// A status of a rank that hears all.
  msg::RankStatus said(int rank, std::uint64_t incarnation, std::uint64_t coordinator) {
    RankMembership other({rank, 3, "far", kIdentity}, incarnation, now);
    msg::RankStatus status = other.status();
    status.header().message(++messages);
    status.hears() = {100, 101, 102, 200};
    status.coordinator(coordinator);
    return status;
  }
  std::string refusal_of(RankMembership& rank, msg::RankStatus other, int times = 1) {
    for (; times > 0; --times) {
      other.header().message(++messages);
      rank.take(other, now);
      now += kRankHeartbeat;
    }
    return rank.refusal();
  }

  Clock::time_point now = Clock::now();
  std::uint64_t messages = 0;
  RankMembership late{{1, 3, "here", kIdentity}, 200, now};
};

TEST_F(OneRank, OtherOptionsAreRefusedByName) {
  msg::RankStatus other = said(0, 100, 100);
  other.ranks(4);
  EXPECT_EQ(refusal_of(late, other), "--ranks is 3, that of the others 4");

  RankMembership wrong({1, 3, "here", R"({"trainer": {"steps": 8192}, "lockstep": false})"}, 200, now);
  EXPECT_EQ(refusal_of(wrong, said(0, 100, 100)), "") << "the other one has not said its options yet";
  RankMembership first({0, 3, "far", kIdentity}, 100, now);
  first.take(wrong.status(), now);
  first.tick(now);
  EXPECT_EQ(first.refusal(), "");
  EXPECT_EQ(refusal_of(wrong, first.status()), "trainer.steps is 8192, that of the others 4096");
  now += 2 * kRankSilence;
  first.tick(now);
  EXPECT_TRUE(first.status().options().empty());
  EXPECT_EQ(identity_difference(R"({"a": 1, "b": 2})", R"({"a": 1})"), "b is 2, that of the others null");
  EXPECT_EQ(identity_difference(kIdentity, "no JSON"), "");
}

TEST_F(OneRank, ASecondProcessOfALivingRankIsRefused) {
  late.take(said(0, 100, 100), now);
  EXPECT_EQ(refusal_of(late, said(1, 101, 100)), "") << "perhaps the last word of one that was killed";
  EXPECT_EQ(refusal_of(late, said(1, 101, 100), 4), "a living process, on far, has this rank");
  RankMembership first({1, 3, "far", kIdentity}, 101, now);
  first.take(said(0, 100, 100), now);
  EXPECT_EQ(refusal_of(first, late.status(), 5), "");
}

TEST_F(OneRank, ASecondProcessOfItsRankIsNotHeardWhileTheFirstLives) {
  late.take(said(0, 100, 100), now);
  msg::RankStatus copy = said(0, 99, 99);
  for (int i = 0; i < 20; ++i) {
    late.take(copy, now);
    late.take(said(0, 100, 100), now);
    now += kRankHeartbeat;
  }
  EXPECT_EQ(late.status().coordinator(), 100u);
  EXPECT_EQ(late.missing(), std::vector<int>{2});
}

TEST_F(OneRank, WhatHearsNobodyIsNotFollowed) {
  msg::RankStatus deaf = said(0, 100, 100);
  deaf.hears().clear();
  late.take(deaf, now);
  EXPECT_EQ(late.status().hears(), std::vector<std::uint64_t>{100});
  EXPECT_EQ(late.missing(), (std::vector<int>{0, 2}));
  EXPECT_EQ(late.status().coordinator(), 200u);
}

TEST_F(OneRank, LeavesAtOnce) {
  msg::RankStatus other = said(0, 100, 100);
  other.hears() = {200};
  late.take(other, now);
  EXPECT_EQ(late.status().coordinator(), 100u);
  other.leaves(true);
  other.header().message(++messages);
  late.take(other, now);
  EXPECT_EQ(late.status().coordinator(), 200u);
}

}  // namespace
}  // namespace citylearn::testing
