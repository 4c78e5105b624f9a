// SPDX-License-Identifier: Apache-2.0
#include "core/wire/messages.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <limits>
#include <new>
#include <set>

#include "tests/support/records/fast_cdr.h"
#include "tests/support/records/samples.h"
#include "tests/support/text.h"

// The largest single request, to see that hostile lengths do not make decode allocate.
static std::atomic<std::size_t> largest_request{0};
// Out of line, or the compiler takes malloc and delete for a mismatched pair.
[[gnu::noinline]] void* operator new(std::size_t size) {
  if (size > largest_request) largest_request = size;
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
[[gnu::noinline]] void operator delete(void* memory) noexcept { std::free(memory); }
[[gnu::noinline]] void operator delete(void* memory, std::size_t) noexcept { std::free(memory); }

namespace citylearn::testing {
namespace {

template <class Message>
std::string decode_error(const Bytes& bytes) {
  return error_of([&] {
    Message message;
    decode(std::span<const std::byte>(bytes), message);
  });
}

TEST(Messages, EveryTypeGoesRoundAtEverySize) {
  for_each_message([]<class Message>() {
    for (Size size : {Size::kMin, Size::kTypical, Size::kMax}) {
      const Message sent = sample_of<Message>(size);
      const Bytes bytes = encoded(sent);
      // Into a message that held something else before.
      Message received = sample_of<Message>(size == Size::kMax ? Size::kMin : Size::kMax);
      ASSERT_NO_THROW(decode(std::span<const std::byte>(bytes), received)) << topic_of<Message>().type;
      EXPECT_TRUE(equal(sent, received)) << topic_of<Message>().type << ", size " << static_cast<int>(size);
    }
  });
}

TEST(Messages, HaveTheBytesThatFastCdrWrites) {
  for_each_message([]<class Message>() {
    for (Size size : {Size::kMin, Size::kTypical, Size::kMax}) {
      const Message sent = sample_of<Message>(size);
      EXPECT_TRUE(encoded(sent) == fast_cdr(sent)) << topic_of<Message>().type << ", size " << static_cast<int>(size);
    }
  });
}

template <class Object>
void expect_bytes_of_fast_cdr() {
  Filler filler(Size::kTypical);
  Object object;
  visit(object, filler);
  EXPECT_TRUE(encode_object(object) == fast_cdr(object)) << type_of(&object);
}
TEST(Messages, ObjectsHaveTheBytesThatFastCdrWrites) {
#define CITYLEARN_EXPECT(TYPE) expect_bytes_of_fast_cdr<msg::TYPE>();
  CITYLEARN_OBJECTS(CITYLEARN_EXPECT)
#undef CITYLEARN_EXPECT
}

TEST(Messages, LargestIsTheSizeOfTheLargest) {
  for_each_message([]<class Message>() {
    const std::size_t size = encoded(sample_of<Message>(Size::kMax)).size();
    EXPECT_LE(size, topic_of<Message>().largest) << topic_of<Message>().type;
    EXPECT_GE(size + 16, topic_of<Message>().largest) << topic_of<Message>().type;  // alignment is counted at its worst
  });
}

TEST(Messages, BigEndianIsRead) {
  for_each_message([]<class Message>() {
    const Message sent = sample_of<Message>(Size::kTypical);
    const Bytes bytes = fast_cdr(sent, true);
    ASSERT_EQ(bytes[1], std::byte{0});
    Message received;
    ASSERT_NO_THROW(decode(std::span<const std::byte>(bytes), received)) << topic_of<Message>().type;
    EXPECT_TRUE(equal(sent, received)) << topic_of<Message>().type;
  });
}

TEST(Messages, ABooleanIsZeroOrOne) {
  msg::RunInfo message = sample_of<msg::RunInfo>(Size::kTypical);
  Bytes bytes = encoded(message);
  message.ended(!message.ended());
  const auto [at, _] = std::mismatch(bytes.begin(), bytes.end(), encoded(message).begin());
  *at = std::byte{2};
  EXPECT_EQ(decode_error<msg::RunInfo>(bytes), "citylearn::msg::RunInfo.ended: not a boolean");
}

TEST(Messages, OtherEncapsulationsAreRefused) {
  Bytes bytes = encoded(sample_of<msg::Action>(Size::kTypical));
  for (const unsigned kind : {2u, 3u, 7u, 0x101u}) {  // parameter lists, XCDR2, nonsense
    bytes[0] = static_cast<std::byte>(kind >> 8);
    bytes[1] = static_cast<std::byte>(kind);
    EXPECT_EQ(decode_error<msg::Action>(bytes),
              "citylearn::msg::Action: encapsulation " + std::to_string(kind) + ", should be CDR: 0 or 1");
  }
}

TEST(Messages, PaddingIsAllowedMoreIsNot) {
  Bytes bytes = encoded(sample_of<msg::EpisodeAcknowledgement>(Size::kTypical));
  bytes.resize(bytes.size() + 3);
  EXPECT_EQ(decode_error<msg::EpisodeAcknowledgement>(bytes), "");
  bytes.resize(bytes.size() + 1);
  EXPECT_EQ(decode_error<msg::EpisodeAcknowledgement>(bytes),
            "citylearn::msg::LogAcknowledgement: 4 bytes left over at its end");
}

TEST(Messages, EveryTruncationIsAnError) {
  for_each_message([]<class Message>() {
    const Bytes whole = encoded(sample_of<Message>(Size::kTypical));
    for (std::size_t size = 0; size < whole.size(); ++size) {
      const std::string error = decode_error<Message>(Bytes(whole.begin(), whole.begin() + static_cast<long>(size)));
      ASSERT_NE(error, "") << topic_of<Message>().type << " cut at " << size;
      ASSERT_TRUE(error.starts_with(topic_of<Message>().type)) << error;
    }
  });
}

TEST(Messages, HostileLengthsAllocateNothing) {
  for_each_message([]<class Message>() {
    const Bytes good = encoded(sample_of<Message>(Size::kTypical));
    const std::size_t words = std::min<std::size_t>(good.size() / 4, 200);
    for (const std::uint32_t length : {0xFFFFFFFFu, 0x7FFFFFFFu, 0x40000000u, 0x00040000u, 0u}) {
      for (std::size_t word = 1; word < words; ++word) {
        Bytes bytes = good;
        std::memcpy(bytes.data() + 4 * word, &length, sizeof length);
        largest_request = 0;
        decode_error<Message>(bytes);
        ASSERT_LE(largest_request, 2 * good.size() + 1024) << topic_of<Message>().type << ", word " << word;
      }
    }
  });
}

TEST(Messages, OtherProtocolIsRefusedAtOnce) {
  auto message = sample_of<msg::Action>(Size::kTypical);
  message.header().protocol(msg::PROTOCOL + 1);
  Bytes bytes = encoded(message);
  bytes.resize(12);  // whatever follows
  EXPECT_EQ(decode_error<msg::Action>(bytes), "citylearn::msg::Action.header.protocol: the sender speaks protocol " +
                                                  std::to_string(msg::PROTOCOL + 1) + ", this program " +
                                                  std::to_string(msg::PROTOCOL));
}

TEST(Messages, OverBoundIsNotEncoded) {
  auto message = sample_of<msg::Action>(Size::kMax);
  message.choice().push_back(0);
  Bytes bytes;
  EXPECT_EQ(error_of([&] { encode(message, bytes); }),
            "citylearn::msg::Action.choice: 257 entries, at most 256 are allowed");
}

/// Decodes a message that `change` has changed: "FIELD: what is wrong with it" is expected, or nothing.
template <class Message, class Change>
void expect_error(const std::string& error, Change change) {
  auto message = sample_of<Message>(Size::kTypical);
  change(message);
  EXPECT_EQ(decode_error<Message>(encoded(message)), error.empty() ? "" : topic_of<Message>().type + "." + error);
}

TEST(Messages, NumbersMustBeFiniteWhereNobodyMeansAnythingElse) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  expect_error<msg::Observation>("features: not finite", [&](auto& m) { m.features().back() = nan; });
  expect_error<msg::Observation>("features: not finite", [&](auto& m) { m.features()[0] = -infinite; });
  expect_error<msg::Observation>("reward: not finite", [&](auto& m) { m.reward()[5] = infinite; });
  expect_error<msg::EpisodeStat>("reward: not finite", [&](auto& m) { m.reward() = nan; });
  expect_error<msg::ServiceStatus>("rate: not finite", [&](auto& m) { m.rate() = infinite; });
  expect_error<msg::ServiceStatus>("uptime: not finite", [&](auto& m) { m.uptime() = nan; });
  expect_error<msg::ActorStatus>("waited: not finite", [&](auto& m) { m.waited() = nan; });
  expect_error<msg::TrainingStat>("", [&](auto& m) { m.spl() = nan; });  // a figure that is not there yet
  expect_error<msg::Observation>("", [&](auto& m) {
    m.features()[0] = std::numeric_limits<float>::max();
    m.features()[1] = std::numeric_limits<float>::denorm_min();
  });
}

TEST(Messages, InconsistentContentNamesTypeAndField) {
  expect_error<msg::Observation>("goal: 15 entries, should be 16 as many as frame has",
                                 [](auto& m) { m.goal().pop_back(); });
  expect_error<msg::Observation>("features: 1024 entries, should be 1040: agents x feature_dimension",
                                 [](auto& m) { m.feature_dimension(65); });
  expect_error<msg::Observation>("features: 1024 entries, should be 68719476720: agents x feature_dimension",
                                 [](auto& m) { m.feature_dimension(0xFFFFFFFF); });
  expect_error<msg::Observation>("previous_action: unknown action 3", [](auto& m) { m.previous_action()[3] = 3; });
  const auto place = [](std::uint64_t number, std::uint64_t first) {
    return [=](auto& m) {
      m.log().number() = number;
      m.log().first() = first;
    };
  };
  expect_error<msg::EpisodeStat>("log.number: is 0, they count from 1", place(0, 0));
  expect_error<msg::EpisodeStat>("log.first: is 1000000000000, must be 1..150", place(150, 1'000'000'000'000));
  expect_error<msg::TrainingStat>("log.first: is 0, must be 1..150", place(150, 0));
  expect_error<msg::Trajectory>("log.first: is 151, must be 1..150", place(150, 151));
  expect_error<msg::Action>("choice: unknown action 3", [](auto& m) { m.choice()[0] = 3; });
  expect_error<msg::Action>("", [](auto& m) { m.belief() = {}; });
  expect_error<msg::Action>("belief.likely: 127 entries, should be 128", [](auto& m) {
    m.belief().likely().pop_back();
    m.belief().probability().pop_back();
  });
  expect_error<msg::Scene>("belief.lost: 15 entries, should be 16", [](auto& m) {
    m.belief().lost().pop_back();
    m.belief().entropy().pop_back();
  });
  expect_error<msg::TraversalInfo>("frames: must be 1..1048576", [](auto& m) { m.frames(0); });
  expect_error<msg::TraversalInfo>("agents: must be 1..256", [](auto& m) { m.agents(257); });
  expect_error<msg::TraversalInfo>("feature_dimension: must be at most 262144",
                                   [](auto& m) { m.feature_dimension(msg::MAX_DIMENSION + 1); });
  expect_error<msg::ImageChunk>("data: 4999 entries, should be 5000", [](auto& m) { m.data().pop_back(); });
  expect_error<msg::ImageChunk>("chunk: index 3 is beyond the object", [](auto& m) { m.chunk(3); });
  expect_error<msg::DescriptorChunk>("total_bytes: must be at most 268436480",
                                     [](auto& m) { m.total_bytes(msg::MAX_OBJECT + 1); });
  expect_error<msg::DescriptorStatus>("present: 15 entries, should be 16", [](auto& m) { m.present().pop_back(); });
  expect_error<msg::DescriptorStatus>("", [](auto& m) { m.present().clear(); });
  expect_error<msg::DescriptorStatus>("encoding: block 16 of 16", [](auto& m) { m.encoding()[2] = 16; });
  expect_error<msg::Trajectory>("shown: 32 entries, should be 33, one more than action has",
                                [](auto& m) { m.shown().pop_back(); });
  expect_error<msg::Trajectory>("reward: 31 entries, should be 32 as many as action has",
                                [](auto& m) { m.reward().pop_back(); });
  expect_error<msg::Trajectory>("features: 2112 entries, should be 2145", [](auto& m) { m.feature_dimension(65); });
  expect_error<msg::Trajectory>("action: unknown action 3", [](auto& m) { m.action()[0] = 3; });
  expect_error<msg::Trajectory>("ended: unknown end 3", [](auto& m) { m.ended()[1] = 3; });
}

TEST(Messages, NamesFollowOneRule) {
  const std::string rule = "must be 1 to 64 of the characters A-Z a-z 0-9 . _ -, not dots alone";
  for (const char* name : {"two words", "a,b", "<img>", "\xC3\xA9t\xC3\xA9", "a/b", "a\x1B[2J", ".."}) {
    const std::string error = "'" + one_line(name) + "' " + rule;
    expect_error<msg::EpisodeStat>("sender: " + error, [&](auto& m) { m.header().sender(name); });
    expect_error<msg::ServiceStatus>("session: " + error, [&](auto& m) { m.header().session(name); });
    expect_error<msg::EpisodeStat>("traversal: " + error, [&](auto& m) { m.traversal(name); });
    expect_error<msg::EpisodeStat>("policy: " + error, [&](auto& m) { m.policy(name); });
    expect_error<msg::RunInfo>("agent: " + error, [&](auto& m) { m.agent(name); });
    expect_error<msg::TraversalInfo>("", [&](auto& m) { m.condition(name); });  // a text
  }
  expect_error<msg::RunInfo>("sender: '' " + rule, [](auto& m) { m.header().sender(""); });
  expect_error<msg::RunInfo>("", [](auto& m) { m.learner(""); });
  expect_error<msg::RunInfo>("", [](auto& m) { m.header().sender("Env-1.a_Z"); });
}

TEST(Messages, UnknownEnumeratorIsRefused) {
  auto message = sample_of<msg::TaskSettings>(Size::kMin);
  Bytes bytes = encoded(message);
  message.task_mode(msg::EVALUATE);
  const Bytes other = encoded(message);
  const auto place = std::mismatch(bytes.begin(), bytes.end(), other.begin()).first;
  *place = std::byte{3};
  EXPECT_EQ(decode_error<msg::TaskSettings>(bytes), "citylearn::msg::TaskSettings.task_mode: unknown value 3");
}

TEST(Messages, TopicsAreDistinct) {
  std::set<std::string> names;
  for (const Topic& topic : all_topics()) EXPECT_TRUE(names.insert(topic.name).second) << topic.name;
  int messages = 0;
  for_each_message([&]<class Message>() {
    ++messages;
    EXPECT_TRUE(names.count(topic_of<Message>().name));
  });
  EXPECT_EQ(names.size(), static_cast<std::size_t>(messages));
}

/// The bytes of an object with these fields, and what decoding them says.
template <class Object, class Change>
std::string object_error(Change change) {
  Object object;
  change(object);
  return error_of([&] { EXPECT_EQ(decode_object<Object>(encode_object(object)), object); });
}

TEST(Messages, ObjectsGoRoundOrAreRefused) {
  EXPECT_EQ(object_error<msg::Image>([](auto& m) { m.name("a.png"), m.file({1, 2, 3}); }), "");
  EXPECT_EQ(object_error<msg::RouteMap>([](auto& m) {
              m.position({1, 2}), m.latitude({3, 4}), m.longitude({5, 6});
            }),
            "");
  const std::string map = "citylearn::msg::RouteMap.", descriptor = "citylearn::msg::Descriptor.";
  EXPECT_EQ(object_error<msg::RouteMap>([](auto&) {}), map + "frames: must be 1..1048576");
  EXPECT_EQ(object_error<msg::RouteMap>([](auto& m) {
              m.position({1, 2}), m.latitude({3}), m.longitude({5});
            }),
            map + "latitude: 1 entries, should be 2");
  EXPECT_EQ(object_error<msg::RouteMap>([](auto& m) { m.position({1}), m.latitude({3}); }),
            map + "longitude: 0 entries, should be 1 as many as latitude has");
  EXPECT_EQ(object_error<msg::Traversal>([](auto& m) { m.position({1}), m.features({2, 3}); }), "");
  EXPECT_EQ(object_error<msg::Parameters>([](auto& m) { m.agent("ppo"), m.values({2, 3}); }), "");
  EXPECT_EQ(object_error<msg::Descriptor>([](auto& m) { m.dimension(2), m.values({1, 2}); }), "");
  EXPECT_EQ(object_error<msg::Descriptor>([](auto&) {}), descriptor + "dimension: must be 1..1048576");
  const float infinite = std::numeric_limits<float>::infinity();
  EXPECT_EQ(object_error<msg::Descriptor>([&](auto& m) { m.dimension(1), m.values({infinite}); }),
            descriptor + "values: not finite");
  Bytes bytes = encode_object(msg::Image());
  bytes.resize(bytes.size() - 4);
  EXPECT_EQ(error_of([&] { decode_object<msg::Image>(bytes); }), "citylearn::msg::Image.file: cut short");
}

}  // namespace
}  // namespace citylearn::testing
