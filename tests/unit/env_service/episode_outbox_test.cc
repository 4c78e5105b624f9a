// SPDX-License-Identifier: Apache-2.0
#include "env_service/episode_outbox.h"

#include <gtest/gtest.h>

#include <limits>
#include <map>

#include "tests/support/env/env.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

using Acknowledged = EpisodeOutbox::Acknowledged;

/// An outbox with a clock of the test's own.
class Fixture {
 public:
  explicit Fixture(const std::vector<std::string>& required = {}, std::size_t most = EpisodeOutbox::kCapacity)
      : outbox(required, most) {
    outbox.set_context(settings(msg::TRAIN, 10, 20), "line");
  }
  void end_episodes(int count) {
    for (int i = 0; i < count; ++i) outbox.add({i % 4, 0, 1, 3, 2, 2, 1.0f, true, {5}});
  }
  /// Returns the numbers that go out now; those sent before are negative.
  std::vector<int> sent(std::size_t most = 1u << 20) {
    std::vector<int> numbers;
    while (numbers.size() < most) {
      const auto sending = outbox.next(now);
      if (!sending) break;
      const int number = static_cast<int>(sending->number);
      numbers.push_back(sending->again ? -number : number);
    }
    return numbers;
  }
  Acknowledged acknowledge(const std::string& who, std::uint64_t episode, bool leaving = false,
                           std::uint64_t incarnation = 1) {
    return repeat(who, ++message, episode, leaving, incarnation);
  }
  Acknowledged repeat(const std::string& who, std::uint64_t number, std::uint64_t episode, bool leaving = false,
                      std::uint64_t incarnation = 1) {
    msg::LogAcknowledgement acknowledgement;
    acknowledgement.header().sender() = who.c_str();
    acknowledgement.header().incarnation() = incarnation;
    acknowledgement.header().message() = number;
    acknowledgement.number() = episode;
    acknowledgement.state() = leaving ? msg::LEAVES : msg::READS;
    acknowledged[who] = episode;
    return outbox.acknowledge(acknowledgement, now);
  }
  /// Acknowledges the same again, as recorders do once a second.
  void beats(const std::string& who, bool stopping = false, std::uint64_t incarnation = 1) {
    msg::LogAcknowledgement acknowledgement;
    acknowledgement.header().sender() = who.c_str();
    acknowledgement.header().incarnation() = incarnation;
    acknowledgement.header().message() = ++message;
    acknowledgement.number() = acknowledged[who];
    acknowledgement.state() = stopping ? msg::STOPS : msg::READS;
    outbox.acknowledge(acknowledgement, now);
  }

  EpisodeOutbox outbox;
  Clock::time_point now = Clock::time_point() + std::chrono::hours(1);
  std::uint64_t message = 0;
  std::map<std::string, std::uint64_t> acknowledged;  // by recorder
};

std::vector<int> from_to(int first, int last) {
  std::vector<int> numbers;
  for (int i = first; i <= last; ++i) numbers.push_back(i);
  return numbers;
}
std::vector<int> again(int first, int last) {
  std::vector<int> numbers = from_to(first, last);
  for (int& number : numbers) number = -number;
  return numbers;
}

TEST(EpisodeOutbox, SendsEachOnceAtOnceAndThenLessAndLessOftenUntilItIsAcknowledged) {
  Fixture fixture;
  fixture.end_episodes(100);
  EXPECT_EQ(fixture.sent(), from_to(1, 100)) << "new ones are not held back";
  EXPECT_EQ(fixture.outbox.due(), fixture.now + milliseconds(200));
  fixture.now += milliseconds(199);
  EXPECT_TRUE(fixture.sent().empty());
  fixture.now += milliseconds(1);
  EXPECT_EQ(fixture.sent(), again(1, 64)) << "no more than that to who may not be there";
  std::vector<std::int64_t> waits;
  for (int i = 0; i < 6; ++i) {
    const Clock::time_point due = fixture.outbox.due();
    waits.push_back(std::chrono::duration_cast<milliseconds>(due - fixture.now).count());
    fixture.now = due;
    EXPECT_EQ(fixture.sent(), again(1, 64));
  }
  EXPECT_EQ(waits, (std::vector<std::int64_t>{400, 800, 1600, 2000, 2000, 2000}));
  EXPECT_EQ(fixture.acknowledge("policy", 100), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
  EXPECT_EQ(fixture.outbox.due(), Clock::time_point::max());
  fixture.now += seconds(10);
  EXPECT_TRUE(fixture.sent().empty());
}

TEST(EpisodeOutbox, TellsAllThatThereIsOfAnEpisode) {
  EpisodeOutbox outbox;
  msg::TaskSettings with = settings(msg::EVALUATE, 10, 20);
  with.settings().incarnation() = 77;
  with.settings().version() = 3;
  with.shuffle() = true;
  with.policy() = "blind";
  with.update() = 12;
  with.run_id() = 99;
  outbox.set_context(with, "fall");
  outbox.add({2, 5, 1, 8, 9, 7, 0.5f, true, {1, 2, 3}});
  outbox.set_context(settings(msg::TRAIN, 10, 20), "fall");  // what comes later changes nothing
  msg::EpisodeStat stat;
  outbox.fill(1, stat);
  EXPECT_EQ(stat.settings().incarnation(), 77u);
  EXPECT_EQ(stat.settings().version(), 3u);
  EXPECT_EQ(stat.log().number(), 1u);
  EXPECT_EQ(stat.log().first() - 1, 0u);
  EXPECT_EQ(stat.agent(), 2u);
  EXPECT_TRUE(stat.evaluation());
  EXPECT_EQ(stat.task(), 5u);
  EXPECT_EQ(std::string(stat.traversal().c_str()), "fall");
  EXPECT_EQ(stat.start(), 1u);
  EXPECT_EQ(stat.goal(), 8u);
  EXPECT_EQ(stat.steps(), 9u);
  EXPECT_EQ(stat.shortest(), 7u);
  EXPECT_EQ(stat.reward(), 0.5f);
  EXPECT_TRUE(stat.completed());
  EXPECT_TRUE(stat.shuffled());
  EXPECT_EQ(std::string(stat.policy().c_str()), "blind");
  EXPECT_EQ(stat.update(), 12u);
  EXPECT_EQ(stat.run_id(), 99u);
  EXPECT_EQ(stat.path(), (std::vector<std::uint8_t>{1, 2, 3}));
}

TEST(EpisodeOutbox, KeepsForEachRecorderWhatItLacks) {
  Fixture fixture;
  fixture.acknowledge("policy", 0);
  fixture.acknowledge("dashboard", 0);
  fixture.end_episodes(10);
  EXPECT_EQ(fixture.sent(), from_to(1, 10));
  EXPECT_EQ(fixture.acknowledge("policy", 10), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.acknowledged(), 0u) << "the dashboard has none of them";
  EXPECT_EQ(fixture.acknowledge("dashboard", 4), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.acknowledged(), 4u);
  EXPECT_EQ(fixture.outbox.kept(), 6u);
  msg::EpisodeStat stat;
  fixture.outbox.fill(5, stat);
  EXPECT_EQ(stat.log().number(), 5u);
  EXPECT_EQ(stat.log().first() - 1, 4u) << "a new recorder does not wait for those before";
  fixture.now += milliseconds(200);
  EXPECT_EQ(fixture.sent(), again(5, 10)) << "for the dashboard";
  EXPECT_EQ(fixture.acknowledge("dashboard", 10), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
  // A third one gets what comes from now on.
  fixture.end_episodes(2);
  fixture.sent();
  fixture.acknowledge("policy", 12);
  EXPECT_EQ(fixture.acknowledge("notebook", 0), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.readers(), (std::vector<std::string>{"dashboard", "notebook", "policy"}));
  EXPECT_EQ(fixture.sent(), again(11, 12)) << "and at once what is still kept";
  fixture.acknowledge("dashboard", 12);
  EXPECT_EQ(fixture.outbox.acknowledged(), 10u);
  fixture.acknowledge("notebook", 12);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
}

TEST(EpisodeOutbox, ARecorderThatWasGoneTakesOverAsFastAsItAcknowledges) {
  Fixture fixture;
  constexpr int kMany = 100'000;
  fixture.acknowledge("policy", 0);
  fixture.acknowledge("dashboard", 0);
  for (int i = 0; i < kMany / 100; ++i) {
    fixture.end_episodes(100);
    fixture.sent();
    fixture.acknowledge("policy", fixture.outbox.last());
  }
  EXPECT_EQ(fixture.outbox.kept(), static_cast<std::size_t>(kMany));
  // Another process, whose store holds the first 50: no time passes from here on.
  fixture.now += kSilence;
  EXPECT_EQ(fixture.acknowledge("dashboard", 50, false, 2), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.acknowledged(), 50u);
  std::uint64_t has = 50;
  int commits = 0;
  while (has < kMany) {
    const std::vector<int> some = fixture.sent();
    ASSERT_FALSE(some.empty()) << "stuck behind " << has;
    ASSERT_LE(some.size(), 1024u);
    for (const int number : some) ASSERT_EQ(static_cast<std::uint64_t>(-number), ++has);
    fixture.acknowledge("dashboard", has, false, 2);
    ++commits;
  }
  EXPECT_LT(commits, 150) << "a commit of 5 ms each: under a second";
  EXPECT_EQ(fixture.outbox.kept(), 0u);
}

TEST(EpisodeOutbox, TheNewestWordOfARecorderCounts) {
  Fixture fixture;
  fixture.end_episodes(20);
  fixture.sent();
  fixture.acknowledge("dashboard", 0);
  fixture.acknowledge("policy", 0);
  fixture.sent();
  EXPECT_EQ(fixture.acknowledge("dashboard", 8), Acknowledged::kYes);
  const std::uint64_t old = fixture.message;
  EXPECT_EQ(fixture.acknowledge("dashboard", 15), Acknowledged::kYes);
  EXPECT_EQ(fixture.repeat("dashboard", old, 8), Acknowledged::kRepeated) << "late";
  EXPECT_EQ(fixture.repeat("dashboard", fixture.message, 15), Acknowledged::kRepeated) << "twice";
  EXPECT_EQ(fixture.acknowledge("dashboard", 15), Acknowledged::kRepeated) << "nothing new in it";
  EXPECT_EQ(fixture.acknowledge("dashboard", 21), Acknowledged::kImpossible);
  EXPECT_EQ(fixture.repeat("dashboard", std::numeric_limits<std::uint64_t>::max(), 15), Acknowledged::kRepeated);
  EXPECT_EQ(fixture.acknowledge("dashboard", 16), Acknowledged::kRepeated) << "after a forged number";
  fixture.now += kSilence - std::chrono::seconds(1);
  fixture.acknowledge("dashboard", 16);
  fixture.now += std::chrono::seconds(1);
  EXPECT_EQ(fixture.acknowledge("dashboard", 16), Acknowledged::kYes) << "it counts for so long alone";
  fixture.sent();
  // Its store was lost: it gets again what is still kept for the policy_service.
  EXPECT_EQ(fixture.acknowledge("dashboard", 0, false, 2), Acknowledged::kRepeated) << "the process before lives";
  fixture.now += kSilence;
  EXPECT_EQ(fixture.acknowledge("dashboard", 0, false, 2), Acknowledged::kYes);
  EXPECT_EQ(fixture.sent(), again(1, 20));
  EXPECT_EQ(fixture.repeat("dashboard", 1000, 20, false, 1), Acknowledged::kRepeated) << "of the process before";
  fixture.acknowledge("policy", 20);
  EXPECT_EQ(fixture.outbox.kept(), 20u);
  fixture.acknowledge("dashboard", 20, false, 2);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
}

TEST(EpisodeOutbox, ManyRecordersNeedNoMoreMemory) {
  Fixture fixture;
  fixture.end_episodes(1);
  fixture.acknowledge("dashboard", 0);
  for (std::size_t i = 1; i < EpisodeOutbox::kMaxRecorders; ++i)
    EXPECT_NE(fixture.acknowledge("stranger-" + std::to_string(i), 0), Acknowledged::kTooMany);
  EXPECT_EQ(fixture.acknowledge("another", 0), Acknowledged::kTooMany);
  EXPECT_EQ(fixture.acknowledge("dashboard", 1), Acknowledged::kYes) << "who is known stays";
  fixture.acknowledge("stranger-5", 1, /*leaving=*/true);
  EXPECT_EQ(fixture.acknowledge("another", 0), Acknowledged::kTooMany) << "late messages may still come";
  fixture.now += kSilence;
  EXPECT_EQ(fixture.acknowledge("another", 0), Acknowledged::kYes);
}

TEST(EpisodeOutbox, NothingIsKeptForWhoLeft) {
  Fixture fixture;
  fixture.acknowledge("policy", 0);
  fixture.acknowledge("dashboard", 0);
  fixture.end_episodes(10);
  fixture.sent();
  fixture.acknowledge("dashboard", 10);
  const std::uint64_t old = fixture.message;
  EXPECT_EQ(fixture.outbox.kept(), 10u);
  EXPECT_EQ(fixture.acknowledge("policy", 3, /*leaving=*/true), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
  EXPECT_EQ(fixture.outbox.readers(), std::vector<std::string>{"dashboard"});
  fixture.repeat("policy", old, 2);
  EXPECT_EQ(fixture.outbox.readers(), std::vector<std::string>{"dashboard"})
      << "what comes late does not bring it back";
  EXPECT_EQ(fixture.acknowledge("stranger", 0, true), Acknowledged::kRepeated);
  EXPECT_EQ(fixture.acknowledge("policy", 0), Acknowledged::kYes) << "its next run";
  EXPECT_EQ(fixture.outbox.readers(), (std::vector<std::string>{"dashboard", "policy"}));
  // When the last one leaves, what it has not is kept for who comes next.
  fixture.end_episodes(5);
  fixture.sent();
  fixture.acknowledge("dashboard", 12, true);
  fixture.acknowledge("policy", 12, true);
  EXPECT_TRUE(fixture.outbox.readers().empty());
  EXPECT_EQ(fixture.outbox.kept(), 3u);
  EXPECT_EQ(fixture.acknowledge("next", 0), Acknowledged::kYes);
  EXPECT_EQ(fixture.sent(), again(13, 15));
}

TEST(EpisodeOutbox, KeepsForRequiredRecordersFromTheStart) {
  Fixture fixture({"dashboard"});
  fixture.acknowledge("policy", 0);
  fixture.end_episodes(10);
  EXPECT_EQ(fixture.sent(), from_to(1, 10));
  fixture.acknowledge("policy", 10);
  EXPECT_EQ(fixture.outbox.kept(), 10u);
  fixture.now += milliseconds(200);
  EXPECT_EQ(fixture.sent(), again(1, 10));
  EXPECT_TRUE(fixture.sent().empty()) << "and not all the time";
  fixture.acknowledge("dashboard", 10);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
}

TEST(EpisodeOutbox, RatherGivesUpTheRecorderThatIsAwayThanMemory) {
  Fixture fixture({}, 1000);
  fixture.acknowledge("dashboard", 0);
  fixture.acknowledge("policy", 0);
  fixture.end_episodes(900);
  fixture.sent();
  fixture.acknowledge("policy", 900);
  EXPECT_EQ(fixture.outbox.problem(), "");
  fixture.end_episodes(101);
  EXPECT_EQ(fixture.outbox.problem(),
            "more than 1000 episodes wait for recorder 'dashboard': they are no longer kept for it");
  EXPECT_EQ(fixture.outbox.readers(), std::vector<std::string>{"policy"});
  EXPECT_EQ(fixture.outbox.kept(), 101u) << "those of the other one are";
  EXPECT_EQ(fixture.sent(), from_to(901, 1001));
  fixture.acknowledge("policy", 1001);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
  EXPECT_EQ(fixture.acknowledge("dashboard", 0), Acknowledged::kYes) << "it may come back";
  EXPECT_EQ(fixture.outbox.readers().size(), 2u);
}

TEST(EpisodeOutbox, WithoutAnyRecorderTheOldestGoAndThatIsTold) {
  Fixture fixture({}, 1000);
  fixture.end_episodes(1000);
  EXPECT_EQ(fixture.outbox.problem(), "");
  fixture.end_episodes(50);
  EXPECT_EQ(fixture.outbox.problem(), "more than 1000 episodes and no recorder: the oldest are lost");
  EXPECT_EQ(fixture.outbox.kept(), 1000u);
  EXPECT_EQ(fixture.sent(), from_to(51, 1050));
  EXPECT_EQ(fixture.acknowledge("policy", 0), Acknowledged::kYes);
  fixture.now += milliseconds(200);
  EXPECT_EQ(fixture.sent(), again(51, 114));
}

TEST(EpisodeOutbox, BelievesThePolicyServiceThatIsInChargeAtOnce) {
  Fixture fixture;
  fixture.end_episodes(3);
  EXPECT_EQ(fixture.acknowledge("policy", 1), Acknowledged::kYes);
  EXPECT_EQ(fixture.acknowledge("policy", 3, false, 2), Acknowledged::kRepeated) << "the first may live";
  msg::Header header;
  header.sender() = "policy";
  header.incarnation() = 2;
  fixture.outbox.force_successor(header, fixture.now);
  EXPECT_EQ(fixture.acknowledge("policy", 3, false, 2), Acknowledged::kYes);
  EXPECT_EQ(fixture.outbox.kept(), 0u);
}

TEST(EpisodeOutbox, KnowsWhomToWaitForAtTheEnd) {
  Fixture fixture({"never-seen"});
  fixture.acknowledge("policy", 0);
  fixture.end_episodes(3);
  fixture.sent();
  EXPECT_TRUE(fixture.outbox.reader_expected(fixture.now));
  fixture.now += seconds(4);
  EXPECT_FALSE(fixture.outbox.reader_expected(fixture.now)) << "silent";
  fixture.beats("policy");
  EXPECT_TRUE(fixture.outbox.reader_expected(fixture.now));
  fixture.beats("policy", /*stopping=*/true);
  EXPECT_FALSE(fixture.outbox.reader_expected(fixture.now));
  fixture.beats("policy", false, 2);
  EXPECT_TRUE(fixture.outbox.reader_expected(fixture.now)) << "its next process";
  fixture.now += seconds(2);
  fixture.beats("policy", false, 3);
  fixture.now += seconds(2);
  EXPECT_TRUE(fixture.outbox.reader_expected(fixture.now)) << "one that takes its place in a moment";
  fixture.acknowledge("policy", 3, false, 2);
  EXPECT_FALSE(fixture.outbox.reader_expected(fixture.now)) << "it lacks nothing";
  EXPECT_EQ(fixture.outbox.kept(), 3u);
  fixture.outbox.hurry(fixture.now);
  EXPECT_EQ(fixture.sent(), again(1, 3));
  EXPECT_EQ(fixture.outbox.due(), fixture.now + milliseconds(100));
}

}  // namespace
}  // namespace citylearn::testing
