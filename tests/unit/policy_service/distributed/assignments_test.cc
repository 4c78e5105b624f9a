// SPDX-License-Identifier: Apache-2.0
// How a learner divides env_services among its actors.
#include "policy_service/distributed/assignments.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <utility>

namespace citylearn::testing {
namespace {

/// Env_services and actors that do at once what they are told. Between two divisions all that is open comes again.
class Run : public ::testing::Test {
 protected:
  void env(const std::string& id) { envs_.push_back({id, ++incarnation_, false}); }
  void actor(const std::string& id) { actors_.push_back({id, {}}); }
  void kill(const std::string& id) {
    std::erase_if(actors_, [&](const auto& actor) { return actor.id == id; });
  }
  Assignments::Actor& of(const std::string& id) {
    return *std::find_if(actors_.begin(), actors_.end(), [&](const auto& actor) { return actor.id == id; });
  }
  std::vector<Assignments::Order> divide() { return assignments_.divide(envs_, actors_, now_ += kCommandResendMax); }
  /// Divides and obeys until nothing is left to be told; returns how many orders that took.
  int settle() {
    int orders = 0;
    for (auto told = divide(); !told.empty(); told = divide())
      for (const Assignments::Order& order : told) {
        ++orders;
        auto& serves = of(order.actor).serves;
        if (order.serve) {
          for (const auto& other : actors_)
            EXPECT_FALSE(other.serves.contains(order.incarnation)) << order.env << " is served already";
          serves.insert(order.incarnation);
        } else {
          serves.erase(order.incarnation);
        }
      }
    return orders;
  }
  std::vector<std::size_t> loads() const {
    std::vector<std::size_t> all;
    for (const auto& actor : actors_) all.push_back(actor.serves.size());
    std::sort(all.begin(), all.end());
    return all;
  }

  Assignments assignments_;
  std::vector<Assignments::Env> envs_;
  std::vector<Assignments::Actor> actors_;
  std::uint64_t incarnation_ = 100;
  Clock::time_point now_ = Clock::now();
};
using AssignmentsTest = Run;
using Loads = std::vector<std::size_t>;

TEST_F(AssignmentsTest, AreEvenWithAsFewMovesAsPossible) {
  for (int i = 0; i < 10; ++i) env("env-" + std::to_string(i));
  for (const std::string id : {"a", "b", "c"}) actor(id);
  EXPECT_EQ(settle(), 10);
  EXPECT_EQ(loads(), (Loads{3, 3, 4}));
  actor("d");
  EXPECT_EQ(settle(), 4) << "two are taken from others and given to it";
  EXPECT_EQ(loads(), (Loads{2, 2, 3, 3}));
  const std::size_t had = of("a").serves.size();
  kill("a");
  EXPECT_EQ(settle(), static_cast<int>(had));
  EXPECT_EQ(loads(), (Loads{3, 3, 4}));
  env("late");
  EXPECT_EQ(settle(), 1);
  EXPECT_EQ(loads(), (Loads{3, 4, 4}));
}

TEST_F(AssignmentsTest, WhatIsBusyOrServedIsNotGivenAway) {
  env("one");
  env("two");
  envs_[1].busy = true;  // with somebody else
  actor("a");
  actor("b");
  EXPECT_EQ(settle(), 1);
  EXPECT_EQ(loads(), (Loads{0, 1}));
  envs_[1].busy = false;
  EXPECT_EQ(settle(), 1);
  EXPECT_EQ(loads(), (Loads{1, 1}));
}

TEST_F(AssignmentsTest, ALearnerThatStartsAgainLeavesThemWhereTheyAre) {
  env("one");
  env("two");
  actor("a");
  actor("b");
  of("b").serves = {101, 102};
  const auto orders = divide();
  ASSERT_EQ(orders.size(), 1u) << "one of them is asked back";
  EXPECT_EQ(orders[0], (Assignments::Order{"b", "two", 102, false}));
  EXPECT_EQ(divide(), orders) << "until it is released";
  settle();
  EXPECT_EQ(loads(), (Loads{1, 1}));
}

TEST_F(AssignmentsTest, OfTwoThatServeTheSameOneReleasesIt) {
  env("one");
  actor("a");
  actor("b");
  of("a").serves = of("b").serves = {101};
  settle();
  EXPECT_EQ(loads(), (Loads{0, 1}));
}

TEST_F(AssignmentsTest, WhatAnActorLeavesOrNeverBeginsGoesToAnother) {
  env("one");
  actor("a");
  actor("b");
  settle();
  const std::string first = of("a").serves.empty() ? "b" : "a";
  of(first).serves.clear();  // it lost sight of it
  const auto orders = divide();
  ASSERT_EQ(orders.size(), 1u);
  EXPECT_NE(orders[0].actor, first);
  // That one does not begin. It is told again, however seldom the learner has time to.
  const Clock::time_point given = now_;
  std::string last = orders[0].actor;
  while (last != first && now_ < given + 2 * kCommandGiveUp)
    if (const auto again = divide(); !again.empty()) last = again.front().actor;
  EXPECT_EQ(last, first);
  EXPECT_EQ(now_ - given, kCommandGiveUp + kCommandResendMax);
}

TEST_F(AssignmentsTest, AnOrderIsSentAgainLessAndLessOften) {
  env("one");
  actor("a");
  std::vector<Clock::duration> intervals;
  Clock::time_point last = now_;
  for (const Clock::time_point end = now_ + 5 * kCommandResendMax; now_ < end; now_ += kCommandResend)
    if (!assignments_.divide(envs_, actors_, now_).empty()) intervals.push_back(now_ - std::exchange(last, now_));
  ASSERT_GE(intervals.size(), 8u);
  EXPECT_EQ(intervals[0], Clock::duration()) << "at once";
  EXPECT_EQ(intervals[1], kCommandResend);
  EXPECT_EQ(intervals[2], 2 * kCommandResend);
  EXPECT_EQ(intervals.back(), kCommandResendMax);
  of("a").serves = {101};
  EXPECT_TRUE(divide().empty()) << "until it is confirmed";
}

}  // namespace
}  // namespace citylearn::testing
