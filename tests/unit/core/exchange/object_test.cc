// SPDX-License-Identifier: Apache-2.0
// Objects cut into chunks, asked for, and put together again over a wire that does what it likes.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <optional>
#include <random>
#include <set>

#include "core/exchange/object_fetch.h"
#include "core/exchange/timing.h"

namespace citylearn {
namespace {

/// Bytes that depend on the key. Item 0 has one chunk, item 3 has two full ones and a byte, item 7 has 100; 9 is not
/// there.
Bytes bytes_of(const ObjectKey& key) {
  if (key.item == 9) return {};
  Bytes bytes(key.item == 3 ? 2 * msg::MAX_CHUNK + 1 : key.item == 7 ? 100 * msg::MAX_CHUNK : 5);
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<std::byte>((i / 256 + i + key.item) % 251);
  return bytes;
}

std::shared_ptr<const ObjectBytes> find(const ObjectKey& key) {
  return key.item == 9 ? nullptr : std::make_shared<ObjectBytes>(key, bytes_of(key));
}

struct Wire {
  explicit Wire(const FetchOptions& options = {.hash = 5, .part = 2, .retry = kObjectRetry}) : fetch(options) {}

  /// Asks when it is due, and returns what the server sends then.
  std::vector<msg::ObjectChunk> answer() {
    msg::ObjectRequest request;
    request.header().sender() = "asker";
    if (fetch.ask(now, request)) {
      ++requests;
      server->note(request);
    }
    std::vector<msg::ObjectChunk> chunks;
    msg::ObjectChunk chunk;
    while (server->send(chunk, [&] { chunks.push_back(chunk); })) continue;
    return chunks;
  }
  /// Starts the server again, which knows nothing of what it sent.
  void restart() { server.emplace(find, rejected); }
  void expect_next(std::uint64_t item) {
    const auto object = fetch.next();
    ASSERT_TRUE(object) << item;
    EXPECT_EQ(object->item, item);
    EXPECT_EQ(object->bytes, bytes_of({5, 2, item}));
  }

  std::uint64_t rejected = 0;
  std::optional<ObjectServer> server{std::in_place, find, rejected};
  ObjectFetch fetch;
  Clock::time_point now = Clock::now();
  int requests = 0;
};

TEST(Objects, ComeInAnyOrderAndAsOftenAsTheyLike) {
  std::mt19937_64 numbers(1);
  Wire wire;
  for (const std::uint64_t item : {0, 3, 1}) wire.fetch.want(item);
  std::vector<msg::ObjectChunk> chunks = wire.answer();
  ASSERT_EQ(chunks.size(), 5u) << "one request names them all";
  chunks.insert(chunks.end(), chunks.begin(), chunks.end());
  std::shuffle(chunks.begin(), chunks.end(), numbers);
  int taken = 0;
  for (const msg::ObjectChunk& chunk : chunks) taken += wire.fetch.take(chunk, wire.now) == Taken::kYes;
  EXPECT_EQ(taken, 5);
  std::set<std::uint64_t> items;
  while (const auto object = wire.fetch.next()) {
    EXPECT_EQ(object->bytes, bytes_of({5, 2, object->item}));
    items.insert(object->item);
  }
  EXPECT_EQ(items, (std::set<std::uint64_t>{0, 1, 3}));
  EXPECT_EQ(wire.fetch.missing(), 0u);
  EXPECT_TRUE(wire.answer().empty());
  EXPECT_EQ(wire.requests, 1);
}

TEST(Objects, AreCompleteHoweverMuchIsLost) {
  std::mt19937_64 numbers(2);
  for (const double loss : {0.0, 0.1, 0.5}) {
    Wire wire;
    wire.fetch.want(7);
    wire.fetch.want(3);
    for (int round = 0; round < 1000 && wire.fetch.missing() > 0; ++round) {
      for (const msg::ObjectChunk& chunk : wire.answer())
        if (std::uniform_real_distribution<>()(numbers) >= loss) wire.fetch.take(chunk, wire.now);
      wire.now += kObjectRetry;
      wire.restart();  // it may be killed at any time
    }
    EXPECT_LE(wire.requests, loss == 0 ? 3 : 1000) << "64 chunks a request";
    for (int object = 0; object < 2; ++object) {
      const auto next = wire.fetch.next();
      ASSERT_TRUE(next);
      EXPECT_TRUE(next->bytes == bytes_of({5, 2, next->item})) << next->item;
    }
  }
}

TEST(Objects, AreAskedForAtOnceWhenAllOfARequestHasCome) {
  Wire wire;
  wire.fetch.want(7);
  const auto first = wire.answer();
  ASSERT_EQ(first.size(), std::size_t{msg::MAX_CHUNKS_ASKED});
  EXPECT_TRUE(wire.answer().empty()) << "the answer is on its way";
  for (const msg::ObjectChunk& chunk : first) wire.fetch.take(chunk, wire.now);
  const auto rest = wire.answer();
  ASSERT_EQ(rest.size(), 100 - std::size_t{msg::MAX_CHUNKS_ASKED});
  EXPECT_EQ(rest.front().chunk(), msg::MAX_CHUNKS_ASKED);
}

TEST(Objects, RequestsThatCrossTheirAnswersBringNothingTwice) {
  Wire wire;
  wire.fetch.want(3);
  ASSERT_EQ(wire.answer().size(), 3u);
  wire.now += kObjectRetry;  // all was lost, but the server's clock has not gone on
  EXPECT_TRUE(wire.answer().empty());
  EXPECT_EQ(wire.requests, 2);
  wire.now += kObjectRetry;
  wire.restart();
  EXPECT_EQ(wire.answer().size(), 3u);
}

TEST(Objects, ThatAreNotThereAreSaidToBeSo) {
  Wire wire;
  wire.fetch.want(9);
  wire.fetch.want(1);
  for (const msg::ObjectChunk& chunk : wire.answer()) EXPECT_EQ(wire.fetch.take(chunk, wire.now), Taken::kYes);
  wire.expect_next(9);
  wire.expect_next(1);
}

TEST(Objects, WithAWrongChecksumAreAskedForAnewAndThenGivenUp) {
  Wire wire({.hash = 5, .part = 2, .retry = kObjectRetry, .most_tries = 6});
  wire.fetch.want(3);
  for (int copy = 0; copy < ObjectFetch::kMaxDamaged; ++copy) {
    EXPECT_FALSE(wire.fetch.gave_up(wire.now));
    std::vector<msg::ObjectChunk> chunks = wire.answer();
    ASSERT_EQ(chunks.size(), 3u);
    chunks[1].data()[77] ^= 4;
    int damaged = 0;
    for (const msg::ObjectChunk& chunk : chunks) damaged += wire.fetch.take(chunk, wire.now) == Taken::kDamaged;
    EXPECT_EQ(damaged, 1);
    EXPECT_FALSE(wire.fetch.next());
    wire.now += kObjectRetry;
    wire.restart();
  }
  EXPECT_TRUE(wire.fetch.gave_up(wire.now));
}

TEST(Objects, ThatWereWrittenAnewMeanwhileBeginAnew) {
  Wire wire;
  wire.fetch.want(3);
  std::vector<msg::ObjectChunk> old = wire.answer();
  for (msg::ObjectChunk& chunk : old) chunk.checksum() = 7;
  EXPECT_EQ(wire.fetch.take(old[0], wire.now), Taken::kYes);
  for (int again = 0; again < 2; ++again) {
    wire.now += kObjectRetry;
    wire.restart();
    for (const msg::ObjectChunk& chunk : wire.answer()) wire.fetch.take(chunk, wire.now);
  }
  wire.expect_next(3);
}

TEST(Objects, OfOthersAndOfWrongSizesAreNotTaken) {
  Wire wire({.hash = 5, .part = 2, .retry = kObjectRetry, .max_bytes = 3 * msg::MAX_CHUNK});
  wire.fetch.want(3);
  wire.fetch.want(7);
  const std::vector<msg::ObjectChunk> chunks = wire.answer();
  const auto taken = [&](auto change) {
    msg::ObjectChunk chunk = chunks[2];
    change(chunk);
    return wire.fetch.take(chunk, wire.now);
  };
  EXPECT_EQ(taken([](auto& c) { c.hash() = 6; }), Taken::kNotWanted);
  EXPECT_EQ(taken([](auto& c) { c.part() = 1; }), Taken::kNotWanted);
  EXPECT_EQ(taken([](auto& c) { c.item() = 4; }), Taken::kNotWanted);
  EXPECT_EQ(taken([](auto& c) { c.data().push_back(1); }), Taken::kDamaged);
  EXPECT_EQ(taken([](auto& c) { c.chunk() = 3; }), Taken::kNotWanted) << "beyond the end";
  EXPECT_EQ(wire.fetch.take(chunks[3], wire.now), Taken::kDamaged) << "more than 3 chunks are too much";
  EXPECT_EQ(taken([](auto&) {}), Taken::kYes);
  EXPECT_EQ(taken([](auto&) {}), Taken::kNotWanted);
}

TEST(Objects, ThatNobodyAnswersForAreGivenUp) {
  Wire wire({.hash = 5, .part = 2, .retry = kObjectRetry, .most_tries = 6});
  wire.fetch.want(1);
  int tries = 0;
  msg::ObjectRequest request;
  while (!wire.fetch.gave_up(wire.now)) {
    tries += wire.fetch.ask(wire.now, request);
    wire.now += kStopCheckInterval;
  }
  EXPECT_EQ(tries, 6);
}

TEST(Objects, AreWantedNoLongerOnceDropped) {
  Wire wire;
  wire.fetch.want(0);
  wire.fetch.want(1);
  const auto chunks = wire.answer();
  wire.fetch.drop(0);
  for (const msg::ObjectChunk& chunk : chunks) wire.fetch.take(chunk, wire.now);
  wire.expect_next(1);
  EXPECT_FALSE(wire.fetch.next());
}

TEST(ObjectServer, SendsToOneServiceWhatItSentToAnother) {
  std::uint64_t rejected = 0;
  int found = 0;
  ObjectServer server([&](const ObjectKey& key) { return ++found, find(key); }, rejected);
  msg::ObjectRequest request;
  request.items() = {3, 1};
  for (const char* asker : {"one", "two"}) {
    request.header().sender() = asker;
    server.note(request);
  }
  std::vector<std::string> sent;
  msg::ObjectChunk chunk;
  while (server.send(chunk, [&] { sent.push_back(chunk.receiver().to_string() + std::to_string(chunk.item())); }))
    continue;
  EXPECT_EQ(sent, (std::vector<std::string>{"one3", "one3", "one3", "two3", "two3", "two3", "one1", "two1"}));
  EXPECT_EQ(found, 2) << "it is read once for both";
  request.items() = {0};
  request.chunks() = {0, 8};
  server.note(request);
  server.send(chunk, [&] { sent.push_back("0"); });
  EXPECT_EQ(sent.size(), 9u);
  EXPECT_EQ(rejected, 1u) << "it has one chunk";
}

}  // namespace
}  // namespace citylearn
