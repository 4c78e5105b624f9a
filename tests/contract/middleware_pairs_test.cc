// SPDX-License-Identifier: Apache-2.0
// What holds between a writer and a reader of either vendor: who is gone is noticed, and what does not match is told.
#include <dds/dds.h>
#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <limits>
#include <thread>

#include "core/dds/middleware.h"
#include "core/util/error.h"
#include "tests/support/options.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr std::uint32_t kPairsDomain = 106;
const std::string kType = "citylearn::test::Bytes";

Topic topic(Profile profile) {
  const auto* test = ::testing::UnitTest::GetInstance()->current_test_info();
  std::string name = "test/" + std::string(test->name()) + "/" + std::to_string(getpid());
  std::replace_if(
      name.begin(), name.end(), [](char c) { return c == '-'; }, '_');
  return {name, kType, profile, 4096};
}

class Pairs : public ::testing::TestWithParam<std::tuple<std::string, std::string>> {
 protected:
  const std::unique_ptr<Middleware> writing_ =
      create_middleware(middleware_options(std::get<0>(GetParam()), kPairsDomain, "writer"));
  const std::unique_ptr<Middleware> reading_ =
      create_middleware(middleware_options(std::get<1>(GetParam()), kPairsDomain, "reader"));

  /// Asks both until it holds.
  bool eventually_both(const std::function<bool()>& condition, milliseconds patience = kMaxWait) {
    return eventually(
        [&] {
          for (Middleware* each : {writing_.get(), reading_.get()}) {
            each->wait(Clock::now() + milliseconds(5));
            each->discovery();
          }
        },
        condition, patience);
  }
};

const auto kVendors = ::testing::Values("cyclonedds", "fastdds");
INSTANTIATE_TEST_SUITE_P(All, Pairs, ::testing::Combine(kVendors, kVendors), [](const auto& param_info) {
  return std::get<0>(param_info.param) + "_to_" + std::get<1>(param_info.param);
});

/// Returns a monitor's lines about this test's topic, once there are so many or the deadline has passed.
std::vector<std::string> faults(Middleware& middleware, std::size_t count) {
  std::vector<std::string> lines;
  const std::string begin = "topic " + topic(Profile::kState).name + ": ";
  eventually(
      middleware,
      [&] {
        for (const std::string& line : middleware.discovery().faults())
          if (line.starts_with(begin)) lines.push_back(line.substr(begin.size()));
        return lines.size() >= count;
      },
      seconds(5 * kSlowness));
  std::sort(lines.begin(), lines.end());
  return lines;
}

TEST_P(Pairs, WhatWasDeletedIsUnmatchedWithinASecond) {
  auto publisher = writing_->create_publisher(topic(Profile::kState));
  auto subscription = reading_->create_subscription(topic(Profile::kState));
  const auto matched = [&] { return publisher->matched() == 1 && subscription->matched() == 1; };
  ASSERT_TRUE(eventually_both(matched));
  subscription.reset();
  EXPECT_TRUE(eventually_both([&] { return publisher->matched() == 0; }, seconds(kSlowness)));
  subscription = reading_->create_subscription(topic(Profile::kState));
  ASSERT_TRUE(eventually_both(matched));
  publisher.reset();
  EXPECT_TRUE(eventually_both([&] { return subscription->matched() == 0; }, seconds(kSlowness)));
}

TEST_P(Pairs, AVolatileWriterIsToldOnBothSides) {
  const auto publisher = writing_->create_publisher(topic(Profile::kRos2));
  const auto subscription = reading_->create_subscription(topic(Profile::kState));
  EXPECT_EQ(faults(*reading_, 1), std::vector<std::string>{"'writer' publishes VOLATILE, expected TRANSIENT_LOCAL"});
  EXPECT_EQ(faults(*writing_, 1), std::vector<std::string>{"'reader' reads TRANSIENT_LOCAL, expected VOLATILE"});
  EXPECT_EQ(publisher->matched() + subscription->matched(), 0);
}

TEST_P(Pairs, ADifferentTypeIsToldOnBothSides) {
  Topic other = topic(Profile::kState);
  other.type = "citylearn::test::Numbers";
  const auto publisher = writing_->create_publisher(other);
  const auto subscription = reading_->create_subscription(topic(Profile::kState));
  EXPECT_EQ(faults(*reading_, 1),
            std::vector<std::string>{"'writer' publishes type " + other.type + ", expected " + kType});
  EXPECT_EQ(faults(*writing_, 1),
            std::vector<std::string>{"'reader' reads type " + kType + ", expected " + other.type});
}

TEST_P(Pairs, AReaderThatRequestsLessIsNotAFault) {
  const auto publisher = writing_->create_publisher(topic(Profile::kState));
  const auto subscription = reading_->create_subscription(topic(Profile::kRos2));  // VOLATILE, BEST_EFFORT
  ASSERT_TRUE(eventually_both([&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  EXPECT_TRUE(writing_->discovery().faults().empty());
  EXPECT_TRUE(reading_->discovery().faults().empty());
}

TEST_P(Pairs, AHandlerAnswersWhileAnotherThreadWaits) {
  constexpr std::byte kAnswer{1}, kLeave{2}, kWake{3}, kFail{4};  // what the handler is asked to do
  Topic answer = topic(Profile::kCommand);
  answer.name += "/answer";
  const auto asks = writing_->create_publisher(topic(Profile::kCommand));
  const auto hears = writing_->create_subscription(answer);
  const auto asked = reading_->create_subscription(topic(Profile::kCommand));
  const auto answers = reading_->create_publisher(answer);
  ASSERT_TRUE(eventually_both([&] { return asked->matched() + answers->matched() + hears->matched() == 3; }));
  std::atomic<std::byte> wanted{kAnswer};
  std::atomic<int> left = 0, woken = 0, failed = 0, ended = 0;
  std::atomic<std::thread::id> handled_by;
  Bytes question;
  reading_->answer_at_once([&] {
    if (wanted == kLeave || !asked->take(question)) return false;
    if (wanted == kFail) throw Error("fails");
    answers->publish(question);
    handled_by = std::this_thread::get_id();
    return wanted == kWake;
  });
  std::thread waiting([&] {
    while (!ended) {
      const bool by_handler = wanted != kLeave;
      try {
        if (!reading_->wait(Clock::now() + milliseconds(5))) continue;
        const bool any = asked->take(question);
        left += any && !by_handler;
        woken += !any && wanted == kWake;
      } catch (const Error&) {
        ++failed;
      }
      while (asked->take(question)) continue;
    }
  });
  Bytes sample(16), heard;
  sample[1] = std::byte{1};  // CDR_LE
  const auto ask_until = [&](std::byte what, const std::function<bool()>& condition) {
    wanted = what;
    const auto turn = [&] {
      asks->publish(sample);
      writing_->wait(Clock::now() + milliseconds(5));
    };
    return eventually(turn, condition);
  };
  int heard_back = 0;
  EXPECT_TRUE(ask_until(kAnswer, [&] { return (heard_back += hears->take(heard)) >= 3; }));
  EXPECT_NE(handled_by.load(), waiting.get_id());
  EXPECT_EQ(heard, sample);
  EXPECT_TRUE(ask_until(kLeave, [&] { return left > 0; }));
  EXPECT_TRUE(ask_until(kWake, [&] { return woken > 0; }));
  EXPECT_TRUE(ask_until(kFail, [&] { return failed > 0; }));
  ended = 1;
  waiting.join();
}

// Fast DDS wakes a second thread for each sample if it is to end a time of no length in which requests are ignored.
TEST_P(Pairs, ASampleWakesOneThread) {
  const auto publisher = writing_->create_publisher(topic(Profile::kCommand));
  const auto subscription = reading_->create_subscription(topic(Profile::kCommand));
  ASSERT_TRUE(eventually_both([&] { return publisher->matched() == 1 && subscription->matched() == 1; }));
  Bytes sample(16), heard;
  sample[1] = std::byte{1};  // CDR_LE
  const auto sleeps = [] {
    rusage used{};
    ::getrusage(RUSAGE_SELF, &used);
    return used.ru_nvcsw;
  };
  constexpr int kSamples = 200;
  long fewest = std::numeric_limits<long>::max();  // other work on the machine makes threads wait for each other
  const Clock::time_point deadline = Clock::now() + kMaxWait;
  for (int round = 0; round < 10; ++round) {
    const long before = sleeps();
    for (int i = 0; i < kSamples; ++i) {
      publisher->publish(sample);
      while (!subscription->take(heard)) ASSERT_TRUE(Clock::now() < deadline) << "round " << round << ", sample " << i;
    }
    fewest = std::min(fewest, sleeps() - before);
  }
  EXPECT_LT(fewest, 3 * kSamples / 2);
}

/// An endpoint of a program that has set its quality of service itself, in Cyclone DDS without our settings of it.
class Raw {
 public:
  using Qos = std::function<void(dds_qos_t*)>;

  Raw(bool writes, bool keyed, const Qos& change) {
    static const std::uint32_t kOps[] = {0u | DDS_OP_ADR | DDS_OP_TYPE_4BY, 0, DDS_OP_RTS};
    static const std::uint32_t kKeyedOps[] = {0u | DDS_OP_ADR | DDS_OP_FLAG_KEY | DDS_OP_FLAG_MU | DDS_OP_TYPE_4BY, 0,
                                              DDS_OP_RTS, 0u | DDS_OP_KOF | 1, 0};
    static const dds_key_descriptor_t kKeys[] = {{"number", 3, 0}};
    const dds_topic_descriptor_t type{
        .m_size = 4,
        .m_align = 4,
        .m_flagset = DDS_TOPIC_FIXED_SIZE | (keyed ? DDS_TOPIC_FIXED_KEY | DDS_TOPIC_FIXED_KEY_XCDR2 : 0u),
        .m_nkeys = keyed ? 1u : 0u,
        .m_typename = kType.c_str(),
        .m_keys = keyed ? kKeys : nullptr,
        .m_nops = 2,
        .m_ops = keyed ? kKeyedOps : kOps,
        .m_meta = "",
        .type_information = {},
        .type_mapping = {},
        .restrict_data_representation = 0};
    participant_ = dds_create_participant(kPairsDomain, nullptr, nullptr);  // in the domain of our own middleware
    dds_qos_t* const qos = dds_create_qos();
    dds_qset_reliability(qos, DDS_RELIABILITY_RELIABLE, 0);
    dds_qset_durability(qos, DDS_DURABILITY_TRANSIENT_LOCAL);
    change(qos);
    const dds_entity_t on =
        dds_create_topic(participant_, &type, topic(Profile::kState).name.c_str(), nullptr, nullptr);
    const dds_entity_t parent =
        writes ? dds_create_publisher(participant_, qos, nullptr) : dds_create_subscriber(participant_, qos, nullptr);
    endpoint_ = writes ? dds_create_writer(parent, on, qos, nullptr) : dds_create_reader(parent, on, qos, nullptr);
    dds_delete_qos(qos);
  }
  ~Raw() { dds_delete(participant_); }
  bool is_made() const { return endpoint_ > 0; }

 private:
  dds_entity_t participant_ = 0, endpoint_ = 0;
};

/// Reads and writes by one vendor, and meets raw endpoints of Cyclone DDS.
class Misfits : public ::testing::TestWithParam<std::string> {
 protected:
  const std::unique_ptr<Middleware> domain_ =
      create_middleware(middleware_options("cyclonedds", kPairsDomain, "domain"));
  const std::unique_ptr<Middleware> ours_ = create_middleware(middleware_options(GetParam(), kPairsDomain, "ours"));

  void expect(bool remote_writes, const std::string& fault, const Raw::Qos& change, bool keyed = false) {
    std::unique_ptr<Publisher> publisher;
    std::unique_ptr<Subscription> subscription;
    if (remote_writes)
      subscription = ours_->create_subscription(topic(Profile::kState));
    else
      publisher = ours_->create_publisher(topic(Profile::kState));
    const Raw raw(remote_writes, keyed, change);
    ASSERT_TRUE(raw.is_made()) << fault;
    EXPECT_EQ(faults(*ours_, 1), std::vector<std::string>{"an unnamed participant " + fault});
    EXPECT_EQ(subscription ? subscription->matched() : publisher->matched(), 0) << fault;
  }
};
INSTANTIATE_TEST_SUITE_P(All, Misfits, ::testing::Values("cyclonedds", "fastdds"),
                         [](const auto& param_info) { return param_info.param; });

TEST_P(Misfits, EveryPolicyOfAWriterIsTold) {
  expect(true, "publishes BEST_EFFORT, expected RELIABLE",
         [](dds_qos_t* qos) { dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0); });
  expect(true, "publishes BEST_EFFORT, expected RELIABLE; VOLATILE, expected TRANSIENT_LOCAL", [](dds_qos_t* qos) {
    dds_qset_reliability(qos, DDS_RELIABILITY_BEST_EFFORT, 0);
    dds_qset_durability(qos, DDS_DURABILITY_VOLATILE);
  });
  expect(true, "publishes EXCLUSIVE, expected SHARED",
         [](dds_qos_t* qos) { dds_qset_ownership(qos, DDS_OWNERSHIP_EXCLUSIVE); });
  expect(true, "publishes partition 'robots', expected none",
         [](dds_qos_t* qos) { dds_qset_partition1(qos, "robots"); });
  expect(
      true, "publishes a topic with a key, expected one without", [](dds_qos_t*) {}, true);
}

TEST_P(Misfits, EveryPolicyOfAReaderIsTold) {
  expect(false, "reads a deadline of 0.5 s, expected none",
         [](dds_qos_t* qos) { dds_qset_deadline(qos, DDS_MSECS(500)); });
  expect(false, "reads MANUAL_BY_TOPIC, expected AUTOMATIC; a liveliness lease of 2 s, expected none",
         [](dds_qos_t* qos) { dds_qset_liveliness(qos, DDS_LIVELINESS_MANUAL_BY_TOPIC, DDS_SECS(2)); });
  expect(false, "reads EXCLUSIVE, expected SHARED",
         [](dds_qos_t* qos) { dds_qset_ownership(qos, DDS_OWNERSHIP_EXCLUSIVE); });
}

TEST_P(Misfits, AnEncodingThatIsNotOursIsTold) {
  const auto subscription = ours_->create_subscription(topic(Profile::kState));
  const Raw raw(true, false, [](dds_qos_t* qos) {
    const dds_data_representation_id_t encoding = DDS_DATA_REPRESENTATION_XCDR2;
    dds_qset_data_representation(qos, 1, &encoding);
  });
  ASSERT_TRUE(raw.is_made());
  EXPECT_EQ(faults(*ours_, 1), std::vector<std::string>{"an unnamed participant publishes XCDR2, expected XCDR1"});
}

}  // namespace
}  // namespace citylearn::testing
