// SPDX-License-Identifier: Apache-2.0
#include "policy_service/ranks/coordinator.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;
using std::chrono::milliseconds;

/// A coordinator of three ranks whose connections have the ranks' numbers, and all that it sends.
class CoordinatorTest : public ::testing::Test {
 protected:
  static Json hello(int rank, bool takes_over = false) {
    return {{"type", "hello"},
            {"protocol", kRankProtocol},
            {"version", "1"},
            {"rank", rank},
            {"ranks", 3},
            {"incarnation", "p" + std::to_string(rank)},
            {"address", "127.0.0.1:" + std::to_string(1000 + rank)},
            {"identity", {{"lockstep", false}}},
            {"takeover", takes_over},
            {"committed", takes_over ? 6 : 0},
            {"expected", {"p0", "p1", "p2"}}};
  }
  void arrive(int rank, std::uint64_t committed, std::uint64_t seen) {
    say(rank, {{"type", "arrive"}, {"committed", committed}, {"seen", seen}, {"updates", committed}});
  }
  void vote(int rank, std::uint64_t meeting, bool yes) {
    say(rank, {{"type", "vote"}, {"meeting", meeting}, {"yes", yes}});
  }
  void say(int rank, const Json& message) { coordinator.receive(rank, message, now); }
  /// The last message of a type to a connection; null when there was none since this was asked before.
  Json last(int connection, const std::string& type) {
    Json found;
    for (const Json& message : std::exchange(sent[connection], {}))
      if (message.at("type") == type) found = message;
    return found;
  }
  void all_meet() {
    for (const int rank : {0, 1, 2}) coordinator.introduce(rank, hello(rank), now);
    for (const int rank : {0, 1, 2}) arrive(rank, 0, 0);
    for (const int rank : {0, 1, 2}) ASSERT_EQ(last(rank, "meeting").at("meeting"), 1u);
  }

  std::map<int, std::vector<Json>> sent;
  std::set<int> closed;
  Clock::time_point now = Clock::now();
  Coordinator coordinator{"p0", [this](int connection, const Json* message) {
                            if (message)
                              sent[connection].push_back(*message);
                            else
                              closed.insert(connection);
                          }};
};

TEST_F(CoordinatorTest, BeginsWhenAllAreThereInTheOrderOfRanks) {
  coordinator.introduce(2, hello(2), now);
  coordinator.introduce(0, hello(0), now);
  arrive(2, 0, 0);
  arrive(0, 0, 0);
  EXPECT_TRUE(last(0, "meeting").is_null());
  coordinator.introduce(1, hello(1), now);
  arrive(1, 0, 0);
  const Json meeting = last(1, "meeting");
  ASSERT_EQ(meeting.at("attendees").size(), 3u);
  for (int rank = 0; rank < 3; ++rank) EXPECT_EQ(meeting.at("attendees").at(rank).at("rank"), rank);
}

TEST_F(CoordinatorTest, AnUpdateCountsWhenAllThatLiveHadItsSum) {
  all_meet();
  vote(0, 1, true);
  vote(1, 1, true);
  EXPECT_TRUE(last(0, "decision").is_null()) << "rank 2 is still adding";
  coordinator.lose(2, now);
  EXPECT_TRUE(last(0, "decision").at("yes"));
  arrive(0, 1, 1);
  arrive(1, 1, 1);
  EXPECT_EQ(last(0, "meeting").at("attendees").size(), 2u);
  vote(0, 2, true);
  vote(1, 2, false);
  EXPECT_FALSE(last(0, "decision").at("yes"));
  EXPECT_FALSE(last(1, "decision").at("yes"));
}

TEST_F(CoordinatorTest, GoesOnWithoutWhatIsSilent) {
  all_meet();
  for (const int rank : {0, 1}) vote(rank, 1, true);
  now += milliseconds(1900);
  for (const int rank : {0, 1}) say(rank, {{"type", "alive"}});
  coordinator.tick(now);
  EXPECT_TRUE(last(0, "decision").is_null());
  now += milliseconds(200);
  coordinator.tick(now);
  EXPECT_TRUE(last(0, "decision").at("yes"));
  EXPECT_TRUE(closed.contains(2));
}

TEST_F(CoordinatorTest, TakesOverWhatTheMembersKnow) {
  // Rank 0 coordinated meeting 7 and is lost; rank 1 knows that it counted, or that it did not, or nobody knows.
  for (const auto& [known, yes] : {std::pair("yes", true), {"no", false}, {"nothing", true}}) {
    Coordinator next("p1", [this](int connection, const Json* message) {
      if (message) sent[connection].push_back(*message);
    });
    next.introduce(1, hello(1, true), now);
    EXPECT_TRUE(last(1, "welcome").at("kept"));
    EXPECT_TRUE(next.probe("").at("established")) << "before anybody arrives: a lone rank must not absorb them";
    if (known == std::string("nothing"))
      next.receive(1, {{"type", "vote"}, {"meeting", 7}, {"yes", true}}, now);
    else
      next.receive(1, {{"type", "arrive"}, {"committed", yes ? 7 : 6}, {"seen", 7}}, now);
    EXPECT_TRUE(last(1, "meeting").is_null()) << "rank 2 may come";
    next.introduce(2, hello(2, true), now);
    next.receive(2, {{"type", "vote"}, {"meeting", 7}, {"yes", true}}, now);
    next.tick(now + milliseconds(800));
    EXPECT_EQ(last(2, "decision").at("yes"), yes) << known;
  }
}

TEST_F(CoordinatorTest, ARankThatComesToTheNextCoordinatorTooLateIsANewcomer) {
  coordinator.introduce(1, hello(1, true), now);
  arrive(1, 7, 7);
  now += milliseconds(800);
  coordinator.tick(now);
  EXPECT_EQ(last(1, "meeting").at("meeting"), 8u);
  coordinator.introduce(2, hello(2, true), now);
  EXPECT_FALSE(last(2, "welcome").at("kept"));
}

TEST_F(CoordinatorTest, MarksNewcomers) {
  all_meet();
  for (const int rank : {0, 1, 2}) vote(rank, 1, true);
  arrive(0, 1, 1);
  coordinator.lose(2, now);
  coordinator.introduce(5, hello(2), now);
  arrive(5, 0, 0);
  arrive(1, 1, 1);
  const Json attendees = last(0, "meeting").at("attendees");
  EXPECT_FALSE(attendees.at(0).at("newcomer"));
  EXPECT_TRUE(attendees.at(2).at("newcomer"));
}

TEST_F(CoordinatorTest, RefusesByName) {
  all_meet();
  const auto refusal = [&](const std::string& field, const Json& value) {
    Json wrong = hello(1);
    wrong[field] = value;
    coordinator.introduce(9, wrong, now);
    EXPECT_TRUE(closed.contains(9));
    return last(9, "refused").at("why").get<std::string>();
  };
  EXPECT_TRUE(contains(refusal("protocol", kRankProtocol + 1), "its version 1 has protocol 2 between ranks"));
  EXPECT_EQ(refusal("ranks", 4), "--ranks is 4, that of the others 3");
  EXPECT_EQ(refusal("identity", {{"lockstep", true}}), "lockstep is true, that of the others false");
  EXPECT_EQ(refusal("identity", {{"lockstep", false}, {"initial", "a"}}), "initial is \"a\", that of the others null");
}

TEST_F(CoordinatorTest, ARankIsThatOfOneLivingProcess) {
  all_meet();
  Json twin = hello(2);
  twin["incarnation"] = "another";
  coordinator.introduce(9, twin, now);
  EXPECT_TRUE(last(9, "refused").is_null()) << "perhaps the first one is dead";
  say(2, {{"type", "alive"}});
  EXPECT_TRUE(contains(last(9, "refused").at("why").get<std::string>(), "a living process, at 127.0.0.1:1002,"));
  coordinator.introduce(10, twin, now);
  coordinator.lose(2, now);
  coordinator.tick(now);
  EXPECT_FALSE(last(10, "welcome").is_null());
}

TEST_F(CoordinatorTest, TheGroupThatHasLearnedAbsorbsTheOther) {
  coordinator.introduce(0, hello(0), now);
  EXPECT_TRUE(coordinator.yields_to({{"established", true}, {"members", 1}, {"address", "1.1.1.1:1"}}));
  all_meet();
  for (const int rank : {0, 1, 2}) vote(rank, 1, true);
  EXPECT_FALSE(coordinator.yields_to({{"established", false}, {"members", 9}, {"address", "1.1.1.1:1"}}));
  EXPECT_TRUE(coordinator.yields_to({{"established", true}, {"members", 4}, {"address", "1.1.1.1:1"}}));
  coordinator.hand_over("1.1.1.1:1");
  EXPECT_FALSE(coordinator.serving());
  EXPECT_EQ(last(2, "redirect").at("address"), "1.1.1.1:1");
}

}  // namespace
}  // namespace citylearn::testing
