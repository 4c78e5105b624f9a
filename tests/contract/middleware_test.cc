// SPDX-License-Identifier: Apache-2.0
// What every middleware promises, asked of each of them: core/dds/middleware.h.
#include "core/dds/middleware.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <set>
#include <thread>

#include "core/util/error.h"
#include "core/wire/node.h"
#include "tests/support/options.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kDomain = 101;
constexpr std::uint32_t kOtherDomain = 102;

/// A payload that says who wrote it and as which: encapsulation, writer, number, filler.
Bytes payload(std::uint32_t writer, std::uint32_t number, std::size_t size = 64) {
  Bytes bytes(size);
  bytes[1] = std::byte{1};
  std::memcpy(bytes.data() + 4, &writer, sizeof writer);
  std::memcpy(bytes.data() + 8, &number, sizeof number);
  for (std::size_t i = 12; i < size; ++i) bytes[i] = static_cast<std::byte>(i * 31 + number);
  return bytes;
}
std::uint32_t word(const Bytes& bytes, std::size_t offset) {
  std::uint32_t value = 0;
  if (bytes.size() >= offset + sizeof value) std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}
std::uint32_t writer_of(const Bytes& bytes) { return word(bytes, 4); }
std::uint32_t number_of(const Bytes& bytes) { return word(bytes, 8); }

/// A middleware in two participants, `a` and `b`.
class AnyMiddleware : public ::testing::TestWithParam<std::string> {
 protected:
  static std::unique_ptr<Middleware> make(const std::string& participant, std::uint32_t domain = kDomain) {
    return create_middleware(middleware_options(GetParam(), domain, participant));
  }
  /// A topic of this test in this process alone: tests run side by side.
  static Topic topic(Profile profile = Profile::kCommand, std::size_t largest = 4096,
                     const std::string& type = "citylearn::test::Bytes") {
    const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
    std::string name = "test/" + std::string(test->name()) + "/" + std::to_string(getpid());
    std::replace(name.begin(), name.end(), ':', '_');
    return {name, type, profile, largest};
  }
  static NodeOptions node(const std::string& id, const std::string& session) {
    return {middleware_options(GetParam(), kDomain), "test", id, unique(session)};
  }
  static std::string unique(const std::string& name) { return name + "-" + std::to_string(getpid()); }

  /// Takes what comes until `count` different samples are here.
  static std::vector<Bytes> collect(Middleware& middleware, Subscription& subscription, std::size_t count) {
    std::vector<Bytes> all;
    std::set<std::pair<std::uint32_t, std::uint32_t>> different;
    Bytes sample;
    eventually(middleware, [&] {
      while (subscription.take(sample)) {
        different.emplace(writer_of(sample), number_of(sample));
        all.push_back(sample);
      }
      return different.size() >= count;
    });
    return all;
  }

  std::unique_ptr<Middleware> a = make("a");
  std::unique_ptr<Middleware> b = make("b");
};

/// The middlewares that lose, repeat and reorder nothing once both sides know each other.
class FaithfulMiddleware : public AnyMiddleware {};

const auto kFaithful = ::testing::Values("cyclonedds", "fastdds", "inprocess");
const auto kAll =
    ::testing::Values("cyclonedds", "fastdds", "inprocess", "lossy,drop=0.3,repeat=0.3,reorder=0.3:inprocess");
std::string name_of(const ::testing::TestParamInfo<std::string>& info) {
  return info.param.substr(0, info.param.find_first_of(",:"));
}
INSTANTIATE_TEST_SUITE_P(All, AnyMiddleware, kAll, name_of);
INSTANTIATE_TEST_SUITE_P(All, FaithfulMiddleware, kFaithful, name_of);

TEST_P(AnyMiddleware, SaysItsName) {
  EXPECT_EQ(a->name(), GetParam().starts_with("lossy") ? "lossy:inprocess" : GetParam());
}

TEST_P(AnyMiddleware, DeliversBothWaysWhenSentAgain) {
  const Topic there = topic();
  Topic back = there;
  back.name += "/back";
  const auto ask = a->create_publisher(there), answer = b->create_publisher(back);
  const auto asked = b->create_subscription(there), answered = a->create_subscription(back);
  for (std::uint32_t number = 1; number <= 50; ++number) {
    Bytes sample;
    bool done = false;
    EXPECT_TRUE(eventually(*a, [&] {
      ask->publish(payload(1, number));
      b->wait(Clock::now() + milliseconds(20));
      while (asked->take(sample)) answer->publish(sample);
      b->wait(Clock::now());
      a->wait(Clock::now() + milliseconds(20));
      while (answered->take(sample)) done = done || sample == payload(1, number);
      return done;
    }));
  }
}

TEST_P(AnyMiddleware, LargeSamplesArriveWhenSentAgain) {
  const std::size_t size = 1 << 20;
  const Topic large = topic(Profile::kCommand, size);
  const auto publisher = a->create_publisher(large);
  const auto subscription = b->create_subscription(large);
  Bytes sample;
  Clock::time_point send = Clock::now();
  EXPECT_TRUE(eventually(*b, [&] {
    if (Clock::now() >= send) {
      publisher->publish(payload(1, 7, size));
      send = Clock::now() + milliseconds(500);
    }
    a->wait(Clock::now());
    return subscription->take(sample);
  }));
  EXPECT_TRUE(sample == payload(1, 7, size));
}

TEST_P(AnyMiddleware, EverySizeArrivesWhole) {
  // Payloads are padded to multiples of 4 on the way; the bytes themselves are not touched.
  const Topic sizes = topic(Profile::kDurable);
  const auto publisher = a->create_publisher(sizes);
  const auto subscription = b->create_subscription(sizes);
  for (std::size_t size = 12; size < 40; ++size) {
    Bytes sample;
    EXPECT_TRUE(eventually(*b, [&] {
      publisher->publish(payload(1, static_cast<std::uint32_t>(size), size));
      a->wait(Clock::now());
      b->wait(Clock::now() + milliseconds(50));
      while (subscription->take(sample))
        if (number_of(sample) == size) return true;
      return false;
    }));
    ASSERT_GE(sample.size(), size);
    ASSERT_LT(sample.size(), size + 4);
    sample.resize(size);
    EXPECT_EQ(sample, payload(1, static_cast<std::uint32_t>(size), size));
  }
}

TEST_P(AnyMiddleware, TooLargeASampleIsAnError) {
  const Topic small = topic(Profile::kCommand, 100);
  const auto publisher = a->create_publisher(small);
  EXPECT_NO_THROW(publisher->publish(payload(1, 1, 100)));
  if (GetParam().starts_with("lossy")) return;  // it may drop the sample before anybody looks at its size
  EXPECT_THROW(publisher->publish(payload(1, 1, 101)), Error);
}

TEST_P(AnyMiddleware, MatchedCountsFollow) {
  const auto publisher = a->create_publisher(topic());
  EXPECT_EQ(publisher->matched(), 0);
  auto subscription = b->create_subscription(topic());
  EXPECT_TRUE(eventually(*a, [&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  auto second = b->create_subscription(topic());
  EXPECT_TRUE(eventually(*a, [&] { return publisher->matched() == 2; }));
  subscription.reset();
  second.reset();
  EXPECT_TRUE(eventually(*a, [&] { return publisher->matched() == 0; }));
}

TEST_P(AnyMiddleware, WaitEndsAtTheDeadline) {
  const auto subscription = a->create_subscription(topic());
  Bytes sample;
  EXPECT_FALSE(subscription->take(sample));
  const Clock::time_point deadline = Clock::now() + milliseconds(30);
  EXPECT_FALSE(a->wait(deadline));
  EXPECT_GE(Clock::now(), deadline);
  EXPECT_FALSE(a->wait(Clock::now() - seconds(1)));
}

TEST_P(FaithfulMiddleware, WaitEndsWhenASampleComes) {
  const auto subscription = a->create_subscription(topic());
  const auto publisher = b->create_publisher(topic());
  ASSERT_TRUE(eventually(*a, [&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  std::thread writer([&] { publisher->publish(payload(1, 1)); });
  Bytes sample;
  while (!subscription->take(sample)) ASSERT_TRUE(a->wait(Clock::now() + kMaxWait));
  writer.join();
  EXPECT_EQ(number_of(sample), 1u);
}

TEST_P(FaithfulMiddleware, WaitIsTrueWhileSomethingIsLeft) {
  const auto subscription = a->create_subscription(topic());
  const auto publisher = b->create_publisher(topic());
  ASSERT_TRUE(eventually(*a, [&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  for (std::uint32_t number = 0; number < 10; ++number) publisher->publish(payload(1, number));
  Bytes sample;
  for (std::uint32_t number = 0; number < 10; ++number) {
    while (!subscription->take(sample)) ASSERT_TRUE(a->wait(Clock::now() + kMaxWait));
    EXPECT_EQ(number_of(sample), number);
  }
  EXPECT_FALSE(subscription->take(sample));
}

TEST_P(FaithfulMiddleware, OneWritersSamplesStayInOrder) {
  const auto publisher = a->create_publisher(topic(Profile::kDurable));
  const auto subscription = b->create_subscription(topic(Profile::kDurable));
  ASSERT_TRUE(eventually(*b, [&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  for (std::uint32_t number = 0; number < 200; ++number) publisher->publish(payload(1, number));
  const std::vector<Bytes> samples = collect(*b, *subscription, 200);
  ASSERT_EQ(samples.size(), 200u);
  for (std::uint32_t number = 0; number < 200; ++number) EXPECT_EQ(samples[number], payload(1, number));
}

TEST_P(FaithfulMiddleware, SeveralWritersSamplesAreKeptUntilTaken) {
  const auto subscription = b->create_subscription(topic());
  std::vector<std::unique_ptr<Middleware>> participants;
  std::vector<std::unique_ptr<Publisher>> publishers;
  for (int writer = 0; writer < 4; ++writer) {
    participants.push_back(make("writer"));
    publishers.push_back(participants.back()->create_publisher(topic()));
  }
  ASSERT_TRUE(eventually(*b, [&] {
    return subscription->matched() == 4 && std::all_of(publishers.begin(), publishers.end(),
                                                       [](const auto& publisher) { return publisher->matched() == 1; });
  }));
  for (std::uint32_t number = 0; number < 16; ++number)
    for (std::uint32_t writer = 0; writer < 4; ++writer) publishers[writer]->publish(payload(writer, number));
  const std::vector<Bytes> samples = collect(*b, *subscription, 64);
  EXPECT_EQ(samples.size(), 64u);
  std::uint32_t next[4] = {};
  for (const Bytes& sample : samples) EXPECT_EQ(number_of(sample), next[writer_of(sample)]++);
  publishers.clear();
}

TEST_P(FaithfulMiddleware, ALateJoinerGetsTheLastSamples) {
  for (const auto& [profile, depth] : {std::pair{Profile::kState, 1u}, {Profile::kCommand, 64u}}) {
    Topic kept = topic(profile);
    kept.name += std::to_string(depth);
    const auto publisher = a->create_publisher(kept);
    for (std::uint32_t number = 0; number < 100; ++number) publisher->publish(payload(1, number));
    const auto late = b->create_subscription(kept);
    const std::vector<Bytes> samples = collect(*b, *late, depth);
    ASSERT_EQ(samples.size(), depth);
    for (std::uint32_t i = 0; i < depth; ++i) EXPECT_EQ(samples[i], payload(1, 100 - depth + i));
  }
}

TEST_P(FaithfulMiddleware, ALateJoinerOfRos2GetsWhatComesNext) {
  for (const Profile profile : {Profile::kRos2, Profile::kRos2Reliable}) {
    Topic heard = topic(profile);
    heard.name += profile == Profile::kRos2 ? "" : "_reliable";
    Topic said = heard;
    said.profile = Profile::kRos2;  // its publishers suit both
    const auto publisher = a->create_publisher(said);
    for (std::uint32_t number = 0; number < 5; ++number) publisher->publish(payload(1, number));
    const auto late = b->create_subscription(heard);
    ASSERT_TRUE(eventually(*b, [&] { return publisher->matched() == 1 && late->matched() == 1; })) << heard.name;
    // The first samples after both sides report a match may still be missed.
    Bytes sample;
    std::uint32_t next = 5;
    const auto publish = [&] {
      publisher->publish(payload(1, next++));
      b->wait(Clock::now() + milliseconds(5));
    };
    ASSERT_TRUE(eventually(publish, [&] { return late->take(sample); })) << heard.name;
    EXPECT_GE(number_of(sample), 5u) << "those before it was there are gone";
  }
}

TEST_P(FaithfulMiddleware, DomainsAreApart) {
  const auto elsewhere = make("elsewhere", kOtherDomain);
  const auto publisher = elsewhere->create_publisher(topic());
  const auto subscription = b->create_subscription(topic());
  const auto control = a->create_publisher(topic());
  publisher->publish(payload(2, 1));
  control->publish(payload(1, 1));
  const std::vector<Bytes> samples = collect(*b, *subscription, 1);
  ASSERT_EQ(samples.size(), 1u);
  EXPECT_EQ(writer_of(samples[0]), 1u);
  EXPECT_EQ(publisher->matched(), 0);
}

TEST_P(AnyMiddleware, ADifferentTypeIsAFaultToldOnceOnEachSide) {
  const auto publisher = a->create_publisher(topic(Profile::kCommand, 100, "citylearn::test::This"));
  const auto subscription = b->create_subscription(topic(Profile::kCommand, 100, "citylearn::test::That"));
  std::vector<std::string> at_a, at_b;
  const auto look = [&] {
    for (const auto& [middleware, lines] : {std::pair{a.get(), &at_a}, {b.get(), &at_b}})
      for (const std::string& line : middleware->discovery().faults())
        if (line.find(topic().name + ":") != std::string::npos) lines->push_back(line);
    return !at_a.empty() && !at_b.empty();
  };
  EXPECT_TRUE(eventually(*a, look, seconds(5 * kSlowness)));
  a->wait(Clock::now() + milliseconds(100));
  look();
  EXPECT_EQ(at_a, std::vector<std::string>{"topic " + topic().name +
                                           ": 'b' reads type citylearn::test::That, expected citylearn::test::This"});
  EXPECT_EQ(at_b,
            std::vector<std::string>{"topic " + topic().name +
                                     ": 'a' publishes type citylearn::test::This, expected citylearn::test::That"});
  EXPECT_EQ(publisher->matched(), 0);
}

TEST_P(AnyMiddleware, ADifferentTypeInOneParticipantIsAnError) {
  const auto publisher = a->create_publisher(topic(Profile::kCommand, 100, "citylearn::test::This"));
  EXPECT_THROW(a->create_subscription(topic(Profile::kCommand, 100, "citylearn::test::That")), Error);
}

TEST_P(AnyMiddleware, ComesAndGoesUnderTraffic) {
  const auto publisher = a->create_publisher(topic());
  for (std::uint32_t round = 0; round < 10; ++round) {
    const auto guest = make("guest");
    const auto subscription = guest->create_subscription(topic());
    const auto back = guest->create_publisher(topic());
    Bytes sample;
    EXPECT_TRUE(eventually(*guest, [&] {
      publisher->publish(payload(1, round));
      back->publish(payload(2, round));
      while (subscription->take(sample))
        if (writer_of(sample) == 1 && number_of(sample) == round) return true;
      return false;
    }));
  }
}

TEST_P(AnyMiddleware, NodesIgnoreForeignRunsAndThemselves) {
  Node one(node("one", "run")), two(node("two", "run")), foreign(node("foreign", "other"));
  one.create_reader<msg::RunInfo>();
  two.create_reader<msg::RunInfo>();
  msg::RunInfo sent, received;
  sent.agent("two");
  std::set<std::string> seen;
  const auto turn = [&] {
    one.publish(sent);
    foreign.publish(sent);
    two.publish(sent);
    for (Node* node : {&one, &two, &foreign}) node->wait(Clock::now() + milliseconds(5));
    while (two.take(received)) {
      EXPECT_EQ(received.header().session().to_string(), unique("run"));
      EXPECT_EQ(received.header().sender().to_string(), "one");
      EXPECT_EQ(received.header().incarnation(), one.incarnation());
      EXPECT_EQ(received.agent().to_string(), "two");
      seen.insert("two");
    }
    while (one.take(received)) {
      EXPECT_EQ(received.header().sender().to_string(), "two");
      seen.insert("one");
    }
  };
  EXPECT_TRUE(eventually(turn, [&] { return seen.size() == 2; }));
}

TEST_P(AnyMiddleware, NodesSendHeartbeatsAndChangesOfState) {
  Node sender(node("sender", "heartbeat")), watcher(node("watcher", "heartbeat"));
  watcher.create_reader<msg::ServiceStatus>();
  sender.report(msg::RUNNING, "counting", 5);
  msg::ServiceStatus status, taken;
  std::set<std::uint64_t> heartbeats;
  const auto turn = [&] {
    sender.wait(Clock::now() + milliseconds(20));
    watcher.wait(Clock::now() + milliseconds(20));
    while (watcher.take(taken)) {
      if (taken.service_state() != msg::RUNNING) continue;
      status = taken;
      heartbeats.insert(status.header().message());
    }
  };
  EXPECT_TRUE(eventually(turn, [&] { return heartbeats.size() >= 2; }));
  EXPECT_EQ(status.service().to_string(), "test");
  EXPECT_EQ(status.activity().to_string(), "counting");
  EXPECT_EQ(status.process(), static_cast<std::uint32_t>(getpid()));
  EXPECT_EQ(status.rate(), 5);
}

}  // namespace
}  // namespace citylearn::testing
