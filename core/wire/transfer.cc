// SPDX-License-Identifier: Apache-2.0
#include "core/wire/transfer.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "core/exchange/timing.h"

namespace citylearn {
namespace {

static_assert(msg::MAX_CHUNK % sizeof(float) == 0, "a float never lies in two chunks");
static_assert(std::uint64_t{msg::MAX_FRAMES} * (1 + std::uint64_t{msg::MAX_DIMENSION}) * sizeof(float) /
                      msg::MAX_CHUNK <
                  std::numeric_limits<std::uint32_t>::max(),
              "32 bits number the chunks of the largest traversal");

}  // namespace

std::size_t ChunkLayout::bytes(std::uint32_t chunk) const {
  const std::uint64_t all = frames_ * width_, before = std::uint64_t{chunk} * kFloats;
  return before >= all ? 0 : std::min(all - before, kFloats) * sizeof(float);
}

void ChunkLayout::fill(std::uint32_t chunk, std::span<const float> positions,
                       const std::function<std::span<const float>(std::uint32_t frame)>& features,
                       msg::TraversalChunk& message) const {
  message.frames() = static_cast<std::uint32_t>(frames_);
  message.feature_dimension() = static_cast<std::uint32_t>(width_ - 1);
  message.chunk() = chunk;
  message.data().resize(bytes(chunk));
  auto* to = message.data().data();
  each_piece(chunk, [&](std::uint32_t frame, std::size_t column, std::size_t count, std::size_t) {
    if (column == 0) {
      std::memcpy(to, &positions[frame], sizeof(float));
      to += sizeof(float);
      ++column;
      --count;
    }
    if (count == 0) return;
    std::memcpy(to, features(frame).data() + column - 1, count * sizeof(float));
    to += count * sizeof(float);
  });
}

Transfer::Transfer(const What& what) : what_(what), layout_(what.frames, what.dimension), timer_(kTraversalRetry) {
  if (what_.count == 0) what_.count = what_.frames - what_.first;
  first_chunk_ = layout_.first_chunk(what_.first);
  chunks_ = ChunkSet(layout_.last_chunk(what_.first + what_.count - 1) - first_chunk_ + 1);
  positions.resize(what_.count);
  features.resize(std::size_t{what_.count} * what_.dimension);
}

bool Transfer::wants(const msg::TraversalChunk& chunk) const {
  // The index of a chunk before the first one wanted becomes a large number.
  return chunk.hash() == what_.hash && chunk.feature_dimension() == what_.dimension &&
         chunks_.wants(chunk.chunk() - first_chunk_);
}

bool Transfer::sound(const msg::TraversalChunk& chunk) const {
  if (chunk.frames() != what_.frames || chunk.data().size() != layout_.bytes(chunk.chunk())) return false;
  bool sound = true;
  layout_.each_piece(chunk.chunk(), [&](std::uint32_t, std::size_t column, std::size_t count, std::size_t offset) {
    const auto* data = chunk.data().data() + offset * sizeof(float);
    for (std::size_t i = 0; i < count; ++i) {
      float number;
      std::memcpy(&number, data + i * sizeof(float), sizeof number);
      sound = sound && (std::isfinite(number) || (column + i == 0 && std::isnan(number)));
    }
  });
  return sound;
}

Transfer::Taken Transfer::take(const msg::TraversalChunk& chunk) {
  if (!wants(chunk)) return Taken::kNotWanted;
  if (!sound(chunk)) return Taken::kDamaged;
  const auto* data = chunk.data().data();
  layout_.each_piece(chunk.chunk(),
                     [&](std::uint32_t frame, std::size_t column, std::size_t count, std::size_t offset) {
                       const std::uint32_t place = frame - what_.first;
                       if (place >= what_.count) return;
                       if (column == 0) {
                         std::memcpy(&positions[place], data + offset * sizeof(float), sizeof(float));
                         ++column;
                         ++offset;
                         --count;
                       }
                       if (count == 0) return;
                       std::memcpy(features.data() + std::size_t{place} * what_.dimension + column - 1,
                                   data + offset * sizeof(float), count * sizeof(float));
                     });
  chunks_.add(chunk.chunk() - first_chunk_);
  timer_.answered(Clock::now());
  return Taken::kYes;
}

bool Transfer::ask(Clock::time_point now, msg::TraversalRequest& request) {
  if (complete() || !timer_.is_due(now)) return false;
  request.hash() = what_.hash;
  request.feature_dimension() = what_.dimension;
  request.chunks() = chunks_.first_missing(msg::MAX_CHUNKS_ASKED, first_chunk_);
  timer_.sent(now, request.chunks().size());
  return true;
}

}  // namespace citylearn
