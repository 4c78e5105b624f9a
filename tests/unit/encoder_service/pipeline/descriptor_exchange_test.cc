// SPDX-License-Identifier: Apache-2.0
// Encoder_services send each other descriptors, and something damages or withholds them.
#include "encoder_service/pipeline/descriptor_exchange.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "tests/support/files.h"
#include "tests/support/options.h"
#include "tests/support/wait.h"

namespace citylearn::testing {
namespace {

constexpr int kFrames = 150;           // three blocks
constexpr int kLongDimension = 20000;  // a block is 105 chunks, more than one request may ask for
constexpr std::uint64_t kExchangedHash = 0xC17;

Eigen::VectorXf long_descriptor(int frame, int dimension = kLongDimension) {
  return Eigen::VectorXf::LinSpaced(dimension, static_cast<float>(frame), static_cast<float>(frame) + 0.5f);
}

/// One of the encoder_services of a session.
struct Service {
  explicit Service(const std::string& id, const std::string& encoder = "hog", const std::string& folder = "")
      : node({middleware_options("inprocess"), "encoder_service", id, "exchange"}),
        exchange(node),
        work(folder, {encoder, kLongDimension, kExchangedHash, kFrames}, exchange.division(kExchangedHash, kFrames)) {
    node.create_reader<msg::ServiceStatus>();
    exchange.share(work);
  }
  void put(int first, int end) {
    for (int frame = first; frame < end; ++frame) work.put(frame, long_descriptor(frame));
  }
  void spin() {
    node.wait(Clock::now() + milliseconds(1));
    const Clock::time_point now = Clock::now();
    while (node.take(heartbeat))
      if (heartbeat.service() == "encoder_service") exchange.on_heartbeat(heartbeat, now);
    while (node.take(status)) exchange.on_status(status, now);
    while (node.take(request)) exchange.on_request(request);
    while (node.take(chunk)) exchange.on_chunk(chunk, now);
    exchange.advance(now);
  }
  bool has(int first, int end) const {
    std::vector<float> numbers(kLongDimension);
    for (int frame = first; frame < end; ++frame)
      if (!work.read(frame, numbers) || !std::equal(numbers.begin(), numbers.end(), long_descriptor(frame).data()))
        return false;
    return true;
  }

  Node node;
  DescriptorExchange exchange;
  TraversalWork work;
  msg::ServiceStatus heartbeat;
  msg::DescriptorStatus status;
  msg::DescriptorRequest request;
  msg::DescriptorChunk chunk;
};

TEST(DescriptorExchange, EachFetchesWhatAnotherHas) {
  const Folder folder;
  Service one("one"), two("two", "hog", folder / "two");
  one.put(0, 100);
  two.put(120, kFrames);
  ASSERT_TRUE(
      eventually([&] { one.spin(), two.spin(); }, [&] { return one.work.done() == 130 && two.work.done() == 130; }));
  EXPECT_EQ(one.work.fetched(), 30);
  EXPECT_EQ(two.work.fetched(), 100);
  EXPECT_TRUE(one.has(120, kFrames));
  EXPECT_TRUE(two.has(0, 100));
  const FeatureStore store(folder / "two", two.work.key());
  std::vector<float> numbers(kLongDimension);
  ASSERT_TRUE(store.read(77, numbers)) << "what was fetched is stored";
  EXPECT_TRUE(std::equal(numbers.begin(), numbers.end(), long_descriptor(77).data()));
}

TEST(DescriptorExchange, ThoseWithACommonStoreSendNothing) {
  const Folder folder;
  Service one("one", "hog", folder / "store"), two("two", "hog", folder / "store");
  one.put(0, kFrames);
  ASSERT_TRUE(eventually([&] { one.spin(), two.spin(); }, [&] { return two.work.complete(); }));
  EXPECT_EQ(two.work.fetched(), 0);
  EXPECT_TRUE(two.has(0, kFrames));
}

/// Says that it has frames, and sends something else.
class Liar {
 public:
  Liar() : node_({middleware_options("inprocess"), "encoder_service", "liar", "exchange"}) {
    node_.create_reader<msg::DescriptorRequest>();
    status_.hash(kExchangedHash);
    status_.frames(kFrames);
    status_.encoder() = "hog";
    status_.dimension(kLongDimension);
    status_.present() = {0xFFFF, 0, 0};
    node_.publish(status_);
  }
  /// Answers with descriptors after `change`.
  void spin(
      const std::function<void(msg::Descriptor& object)>& lie,
      const std::function<void(msg::DescriptorChunk& chunk)>& damage = [](auto&) {}) {
    msg::DescriptorRequest request;
    while (node_.take(request)) {
      ++requests;
      msg::Descriptor object;
      object.encoder() = "hog";
      object.dimension(kLongDimension);
      for (int frame = 0; frame < 16; ++frame) {
        const Eigen::VectorXf numbers = long_descriptor(frame);
        object.values().insert(object.values().end(), numbers.begin(), numbers.end());
      }
      lie(object);
      const ObjectBytes bytes({request.hash(), request.part(), request.items()[0]}, encode_object(object));
      for (std::uint32_t index = 0; index < bytes.chunks(); ++index) {
        msg::DescriptorChunk chunk;
        chunk.receiver() = request.header().sender();
        bytes.fill(index, chunk);
        damage(chunk);
        node_.publish(chunk);
      }
    }
  }
  int requests = 0;

 private:
  Node node_;
  msg::DescriptorStatus status_;
};

TEST(DescriptorExchange, DamagedDescriptorsAreRefusedAndEncodedHere) {
  const auto none = [](auto&) {};
  const std::function<void(msg::DescriptorChunk&)> bit = [](auto& chunk) {
    chunk.data()[chunk.data().size() / 2] ^= 4;
  };
  const std::function<void(msg::DescriptorChunk&)> checksum = [](auto& chunk) { chunk.checksum() ^= 1; };
  const std::function<void(msg::Descriptor&)> infinite = [](auto& object) {
    object.values()[0] = std::numeric_limits<float>::infinity();
  };
  const std::function<void(msg::Descriptor&)> other = [](auto& object) { object.encoder() = "other"; };
  const std::function<void(msg::Descriptor&)> few = [](auto& object) { object.values().pop_back(); };
  struct Damage {
    std::function<void(msg::Descriptor&)> lie;
    std::function<void(msg::DescriptorChunk&)> damage;
  };
  const std::map<std::string, Damage> damages = {{"a bit", {none, bit}},
                                                 {"the checksum", {none, checksum}},
                                                 {"not finite", {infinite, none}},
                                                 {"another encoder", {other, none}},
                                                 {"too few", {few, none}}};
  for (const auto& [name, damage] : damages) {
    Service one("one");
    Liar liar;
    const auto free = [&] {
      return one.exchange.division(kExchangedHash, kFrames).is_free(0, 0xFFFF) && liar.requests > 0;
    };
    ASSERT_TRUE(eventually([&] { one.spin(), liar.spin(damage.lie, damage.damage); }, free)) << name;
    EXPECT_EQ(one.work.done(), 0) << name;
    EXPECT_EQ(one.node.traffic.rejected, 3u) << name;
  }
}

TEST(DescriptorExchange, WhatIsNotSentIsEncodedHere) {
  Service one("one");
  Liar liar;
  const auto mute = [](msg::DescriptorChunk& chunk) { chunk.hash() ^= 1; };
  const auto free = [&] {
    return one.exchange.division(kExchangedHash, kFrames).is_free(0, 0xFFFF) && liar.requests > 0;
  };
  ASSERT_TRUE(eventually([&] { one.spin(), liar.spin([](auto&) {}, mute); }, free));
  EXPECT_EQ(one.work.done(), 0);
  EXPECT_EQ(liar.requests, RequestTimer::kDefaultTries);
}

TEST(DescriptorExchange, WhatItIsNotAskedForOrLacksIsNotSent) {
  Service one("one");
  one.put(0, 10);
  Node asker({middleware_options("inprocess"), "test", "asker", "exchange"});
  asker.create_reader<msg::DescriptorChunk>();
  msg::DescriptorRequest request;
  request.server() = "one";
  request.hash(kExchangedHash);
  request.chunks() = {0, 1, 1000};
  const auto answers = [&](std::uint64_t frames, std::uint32_t block) {
    request.part(block);
    request.items() = {frames};
    asker.publish(request);
    one.spin();
    int count = 0;
    for (msg::DescriptorChunk chunk; asker.take(chunk);) count += chunk.total_bytes() > 0;
    return count;
  };
  EXPECT_EQ(answers(0b11, 0), 2) << "chunk 1000 is beyond the end";
  EXPECT_EQ(one.node.traffic.rejected, 1u);
  EXPECT_EQ(answers(1 << 10, 0), 0) << "it lacks frame 10";
  EXPECT_EQ(answers(1, 1), 0);
  EXPECT_EQ(answers(1, 3), 0) << "there is no such block";
  EXPECT_EQ(answers(0, 0), 0);
  request.hash() ^= 1;
  EXPECT_EQ(answers(0b11, 0), 0);
}

}  // namespace
}  // namespace citylearn::testing
