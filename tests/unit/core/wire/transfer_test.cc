// SPDX-License-Identifier: Apache-2.0
// Positions and features cut into chunks and put together again.
#include "core/wire/transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <limits>
#include <numeric>

#include "core/util/random.h"

namespace citylearn {
namespace {

using Taken = Transfer::Taken;

/// F x D numbers that are all different (as far as floats tell), and their chunks.
struct Route {
  Route(std::uint32_t frames, std::uint32_t width) : layout(frames, width), dimension(width) {
    positions.resize(frames);
    features.resize(std::size_t{frames} * dimension);
    std::iota(positions.begin(), positions.end(), -1000.0f);
    std::iota(features.begin(), features.end(), 1.0f);
    for (std::uint32_t index = 0; index < layout.chunks(); ++index) {
      msg::TraversalChunk& chunk = chunks.emplace_back();
      chunk.hash() = 7;
      layout.fill(
          index, positions,
          [&](std::uint32_t frame) {
            return std::span<const float>(features).subspan(std::size_t{frame} * dimension, dimension);
          },
          chunk);
    }
  }
  Transfer transfer(std::uint32_t first = 0, std::uint32_t count = 0) const {
    return Transfer({7, static_cast<std::uint32_t>(positions.size()), dimension, first, count});
  }
  void expect_whole(const Transfer& transfer) const {
    const auto& what = transfer.what();
    EXPECT_TRUE(transfer.complete());
    EXPECT_TRUE(std::equal(transfer.positions.begin(), transfer.positions.end(), positions.begin() + what.first,
                           positions.begin() + what.first + what.count));
    EXPECT_TRUE(std::equal(transfer.features.begin(), transfer.features.end(),
                           features.begin() + std::size_t{what.first} * dimension,
                           features.begin() + std::size_t{what.first + what.count} * dimension));
  }

  ChunkLayout layout;
  std::uint32_t dimension;
  std::vector<float> positions, features;
  std::vector<msg::TraversalChunk> chunks;
};

/// Frames x features: many frames a chunk, chunks that end with a frame, several chunks a frame, positions alone, one
/// frame.
const std::pair<std::uint32_t, std::uint32_t> kSizes[] = {{500, 64},  {7, 12287},  {6, 12288}, {5, 21168}, {30000, 0},
                                                          {24, 4095}, {3, 100000}, {1, 1},     {12288, 0}, {12289, 0}};

TEST(Transfer, NumbersThatAreNotFiniteAreDamage) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  const Route route(4, 3);
  const auto with = [&](std::size_t at, float number) {
    Transfer transfer = route.transfer();
    msg::TraversalChunk chunk = route.chunks[0];
    std::memcpy(chunk.data().data() + at * sizeof number, &number, sizeof number);
    return transfer.take(chunk);
  };
  EXPECT_EQ(with(5, 1e30f), Taken::kYes);
  EXPECT_EQ(with(5, nan), Taken::kDamaged) << "a feature of frame 1";
  EXPECT_EQ(with(7, -infinite), Taken::kDamaged);
  EXPECT_EQ(with(4, nan), Taken::kYes) << "its position, which may be unknown";
  EXPECT_EQ(with(4, infinite), Taken::kDamaged);
}

TEST(ChunkLayout, EveryByteStandsInOneChunkAndAllButTheLastAreFull) {
  for (const auto& [frames, dimension] : kSizes) {
    const ChunkLayout layout(frames, dimension);
    std::size_t bytes = 0;
    for (std::uint32_t chunk = 0; chunk < layout.chunks(); ++chunk) {
      if (chunk + 1 < layout.chunks()) {
        EXPECT_EQ(layout.bytes(chunk), std::size_t{msg::MAX_CHUNK});
      }
      EXPECT_GT(layout.bytes(chunk), 0u);
      bytes += layout.bytes(chunk);
    }
    EXPECT_EQ(bytes, std::size_t{frames} * (1 + dimension) * 4) << frames << " x " << dimension;
    EXPECT_EQ(layout.bytes(layout.chunks()), 0u);
    EXPECT_EQ(layout.bytes(0xFFFFFFFF), 0u);
    EXPECT_EQ(layout.first_chunk(0), 0u);
    EXPECT_EQ(layout.last_chunk(frames - 1), layout.chunks() - 1);
  }
}

TEST(ChunkLayout, TheLargestTraversalIsCountedWithoutOverflow) {
  const ChunkLayout layout(msg::MAX_FRAMES, msg::MAX_DIMENSION);
  EXPECT_EQ(layout.chunks(), 22369707u);  // idl/traversal.idl
  EXPECT_EQ(std::uint64_t{layout.chunks() - 1} * msg::MAX_CHUNK + layout.bytes(layout.chunks() - 1),
            std::uint64_t{1048576} * 262145 * 4);
  EXPECT_EQ(layout.last_chunk(msg::MAX_FRAMES - 1), 22369706u);
}

TEST(Transfer, TakesChunksInAnyOrderAndRepeated) {
  for (const auto& [frames, dimension] : kSizes) {
    const Route route(frames, dimension);
    std::vector<std::size_t> order(2 * route.chunks.size());  // each twice
    std::iota(order.begin(), order.end(), 0);
    Random random{frames, dimension};
    for (std::size_t i = order.size(); i > 1; --i) std::swap(order[i - 1], order[random.below(static_cast<int>(i))]);
    Transfer transfer = route.transfer();
    std::uint32_t taken = 0;
    for (const std::size_t i : order) taken += transfer.take(route.chunks[i % route.chunks.size()]) == Taken::kYes;
    EXPECT_EQ(taken, route.layout.chunks());
    route.expect_whole(transfer);
  }
}

TEST(Transfer, AsksForTheChunksOfItsFramesAlone) {
  const Route route(50, 21168);
  for (const auto& [first, count] : {std::pair{0u, 1u}, {17u, 3u}, {49u, 1u}, {10u, 40u}}) {
    Transfer transfer = route.transfer(first, count);
    msg::TraversalRequest request;
    std::uint32_t asked = 0;
    while (transfer.ask(Clock::now(), request)) {
      EXPECT_EQ(request.hash(), 7u);
      EXPECT_EQ(request.feature_dimension(), 21168u);
      ASSERT_LE(request.chunks().size(), std::size_t{msg::MAX_CHUNKS_ASKED});
      for (const std::uint32_t chunk : request.chunks()) {
        ++asked;
        ASSERT_EQ(transfer.take(route.chunks.at(chunk)), Taken::kYes);
      }
    }
    EXPECT_EQ(asked, (std::uint64_t{first + count} * 21169 * 4 - 1) / msg::MAX_CHUNK -
                         std::uint64_t{first} * 21169 * 4 / msg::MAX_CHUNK + 1);
    route.expect_whole(transfer);
    EXPECT_EQ(transfer.take(route.chunks[0]), Taken::kNotWanted);
    EXPECT_EQ(transfer.take(route.chunks.back()), Taken::kNotWanted);
  }
}

TEST(Transfer, AsksAgainForWhatDidNotComeAndAtOnceWhenAllCame) {
  const Route route(100, 21168);
  Transfer transfer = route.transfer();
  msg::TraversalRequest request;
  const Clock::time_point now = Clock::now();
  EXPECT_LE(transfer.due(), now);
  ASSERT_TRUE(transfer.ask(now, request));
  EXPECT_FALSE(transfer.ask(now, request)) << "they are on their way";
  for (std::uint32_t chunk = 0; chunk < 63; ++chunk)
    if (chunk != 3) transfer.take(route.chunks[chunk]);
  EXPECT_GT(transfer.due(), now) << "chunks 3 and 63 did not come";
  ASSERT_TRUE(transfer.ask(transfer.due(), request));
  ASSERT_EQ(request.chunks().size(), 64u);
  EXPECT_EQ(request.chunks()[0], 3u);
  EXPECT_EQ(request.chunks()[1], 63u);
  EXPECT_EQ(request.chunks()[2], 64u);
  const auto asked = request.chunks();
  for (const std::uint32_t chunk : asked) {
    EXPECT_FALSE(transfer.ask(now, request));
    transfer.take(route.chunks[chunk]);
  }
  EXPECT_TRUE(transfer.ask(now, request)) << "at once";
}

TEST(Transfer, DamagedAndForeignChunksChangeNothing) {
  const Route route(40, 4096);
  Transfer transfer = route.transfer(10, 20);
  const std::uint32_t wanted = route.layout.first_chunk(10);
  const auto with = [&](auto change) {
    msg::TraversalChunk chunk = route.chunks[wanted];
    std::fill(chunk.data().begin(), chunk.data().end(), std::uint8_t{0xFF});
    change(chunk);
    return transfer.take(chunk);
  };
  EXPECT_EQ(with([](auto& c) { c.hash() = 8; }), Taken::kNotWanted);
  EXPECT_EQ(with([](auto& c) { c.feature_dimension() = 4095; }), Taken::kNotWanted);
  EXPECT_EQ(with([](auto& c) { c.chunk() -= 1; }), Taken::kNotWanted);
  EXPECT_EQ(with([](auto& c) { c.chunk() = 0xFFFFFFFF; }), Taken::kNotWanted);
  EXPECT_EQ(with([](auto& c) { c.frames() = 41; }), Taken::kDamaged);
  EXPECT_EQ(with([](auto& c) { c.data().pop_back(); }), Taken::kDamaged);
  EXPECT_EQ(with([](auto& c) { c.data().clear(); }), Taken::kDamaged);
  EXPECT_EQ(with([](auto& c) { c.data().push_back(0); }), Taken::kDamaged);
  EXPECT_EQ(transfer.missing(), route.layout.last_chunk(29) - wanted + 1);
  for (const auto& chunk : route.chunks) transfer.take(chunk);
  route.expect_whole(transfer);
}

}  // namespace
}  // namespace citylearn
