// SPDX-License-Identifier: Apache-2.0
// Positions and features of frames as objects, and put together again.
#include "core/wire/transfer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <numeric>

#include "core/util/random.h"

namespace citylearn {
namespace {

/// F x D numbers that are all different (as far as floats tell).
struct Route {
  Route(std::uint32_t frames, std::uint32_t width) : dimension(width), positions(frames) {
    features.resize(std::size_t{frames} * dimension);
    std::iota(positions.begin(), positions.end(), -1000.0f);
    std::iota(features.begin(), features.end(), 1.0f);
  }
  std::shared_ptr<const ObjectBytes> object(std::uint64_t first) const {
    return traversal_object({7, dimension, first}, positions, [&](std::uint32_t frame) {
      return std::span<const float>(features).subspan(std::size_t{frame} * dimension, dimension);
    });
  }
  std::vector<msg::TraversalChunk> chunks(std::uint64_t first) const {
    const auto whole = object(first);
    std::vector<msg::TraversalChunk> all(whole->chunks());
    for (std::uint32_t index = 0; index < whole->chunks(); ++index) whole->fill(index, all[index]);
    return all;
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

  std::uint32_t dimension;
  std::vector<float> positions, features;
};

/// Frames x features: one object, objects that end with the traversal, several of them, one a frame, positions alone.
const std::pair<std::uint32_t, std::uint32_t> kSizes[] = {{500, 64},  {128, 12287}, {70, 12287}, {5, 200000},
                                                          {30000, 0}, {1, 1},       {786433, 0}, {600, 4095}};

TEST(Transfer, TakesChunksInAnyOrderAndRepeated) {
  for (const auto& [frames, dimension] : kSizes) {
    const Route route(frames, dimension);
    std::vector<msg::TraversalChunk> chunks;
    for (std::uint64_t first = 0; first < frames; first += frames_per_object(dimension))
      for (int time = 0; time < 2; ++time)
        for (const msg::TraversalChunk& chunk : route.chunks(first)) chunks.push_back(chunk);
    Random random{frames, dimension};
    for (std::size_t i = chunks.size(); i > 1; --i) std::swap(chunks[i - 1], chunks[random.below(static_cast<int>(i))]);
    Transfer transfer = route.transfer();
    std::size_t taken = 0;
    for (const msg::TraversalChunk& chunk : chunks) taken += transfer.take(chunk) == Taken::kYes;
    EXPECT_EQ(taken, chunks.size() / 2);
    route.expect_whole(transfer);
  }
}

TEST(Transfer, AsksForTheObjectsOfItsFramesAlone) {
  const Route route(150, 21168);
  const std::uint32_t most = frames_per_object(21168);
  ASSERT_EQ(most, 37u) << "786,416 floats";
  for (const auto& [first, count] : {std::pair{0u, 1u}, {36u, 2u}, {149u, 1u}, {37u, 37u}, {10u, 140u}}) {
    Transfer transfer = route.transfer(first, count);
    msg::TraversalRequest request;
    EXPECT_EQ(transfer.missing(), (first + count - 1) / most - first / most + 1);
    while (transfer.ask(Clock::now(), request)) {
      EXPECT_EQ(request.hash(), 7u);
      EXPECT_EQ(request.part(), 21168u);
      for (const std::uint64_t item : request.items())
        for (const msg::TraversalChunk& chunk : route.chunks(item)) ASSERT_EQ(transfer.take(chunk), Taken::kYes);
    }
    route.expect_whole(transfer);
    EXPECT_EQ(transfer.take(route.chunks(0)[0]), Taken::kNotWanted);
  }
}

TEST(Transfer, NumbersThatAreNotFiniteAreDamage) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), infinite = std::numeric_limits<float>::infinity();
  const auto with = [&](bool feature, float number) {
    Route route(4, 3);
    (feature ? route.features[5] : route.positions[1]) = number;
    Transfer transfer = route.transfer();
    const Taken taken = transfer.take(route.chunks(0)[0]);
    EXPECT_EQ(transfer.complete(), taken == Taken::kYes);
    return taken;
  };
  EXPECT_EQ(with(true, 1e30f), Taken::kYes);
  EXPECT_EQ(with(true, nan), Taken::kDamaged);
  EXPECT_EQ(with(true, -infinite), Taken::kDamaged);
  EXPECT_EQ(with(false, nan), Taken::kYes) << "a position may be unknown";
  EXPECT_EQ(with(false, infinite), Taken::kDamaged);
}

TEST(Transfer, DamagedAndForeignObjectsChangeNothing) {
  const Route route(40, 4096), longer(41, 4096);
  Transfer transfer = route.transfer(10, 20);
  msg::TraversalChunk foreign = route.chunks(0)[0];
  foreign.hash() = 8;
  EXPECT_FALSE(transfer.wants(foreign));
  EXPECT_EQ(transfer.take(foreign), Taken::kNotWanted);
  Taken last = Taken::kYes;
  for (const msg::TraversalChunk& chunk : longer.chunks(0)) last = transfer.take(chunk);
  EXPECT_EQ(last, Taken::kDamaged) << "another number of frames";
  EXPECT_EQ(transfer.missing(), 1u);
  for (const msg::TraversalChunk& chunk : route.chunks(0)) transfer.take(chunk);
  route.expect_whole(transfer);
}

TEST(Transfer, ObjectsBeginAtMultiplesAndOnTheTraversal) {
  const Route route(500, 64);
  EXPECT_NE(route.object(0), nullptr);
  EXPECT_EQ(route.object(1), nullptr);
  EXPECT_LE(Route(40000, 18).object(0)->chunks(), msg::MAX_CHUNKS_ASKED);
  EXPECT_EQ(route.object(frames_per_object(64)), nullptr) << "beyond the end";
  EXPECT_EQ(frames_per_object(msg::MAX_DIMENSION), 2u);
  EXPECT_EQ(frames_per_object(0), msg::MAX_RANGE);
}

}  // namespace
}  // namespace citylearn
