// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "core/exchange/blob.h"
#include "core/util/types.h"
#include "idl/traversal.h"

namespace citylearn {

/// The layout of a traversal's frames in TraversalChunks (idl/traversal.idl): 1 + D floats a frame, end to end, cut
/// every MAX_CHUNK bytes.
class ChunkLayout {
 public:
  /// Takes 1..MAX_FRAMES frames of 0..MAX_DIMENSION features.
  ChunkLayout(std::uint32_t frames, std::uint32_t dimension) : frames_(frames), width_(1 + std::uint64_t{dimension}) {}

  /// Returns the number of chunks: at most 22,369,707, so 32 bits number them. Bytes are counted in 64.
  std::uint32_t chunks() const { return chunk_of(frames_ * width_ - 1) + 1; }
  /// Returns the bytes of a chunk; 0 beyond the last.
  std::size_t bytes(std::uint32_t chunk) const;
  /// Return the chunks in which a frame's record begins and ends.
  std::uint32_t first_chunk(std::uint32_t frame) const { return chunk_of(frame * width_); }
  std::uint32_t last_chunk(std::uint32_t frame) const { return chunk_of((frame + 1) * width_ - 1); }

  /// Calls `visit(frame, column, count, offset)` for each frame that has a part in the chunk: floats column .. column +
  /// count - 1 of its record stand at float `offset` of the chunk. Column 0 is the position.
  template <class Visit>
  void each_piece(std::uint32_t chunk, Visit visit) const {
    const std::uint64_t begin = std::uint64_t{chunk} * kFloats, end = begin + bytes(chunk) / sizeof(float);
    for (std::uint64_t at = begin; at < end;) {
      const std::uint64_t frame = at / width_, after = std::min(end, (frame + 1) * width_);
      visit(static_cast<std::uint32_t>(frame), static_cast<std::size_t>(at % width_),
            static_cast<std::size_t>(after - at), static_cast<std::size_t>(at - begin));
      at = after;
    }
  }

  /// Fills all of a message but its header and hash. `features(frame)` gives D floats, and is not called when D is 0.
  void fill(std::uint32_t chunk, std::span<const float> positions,
            const std::function<std::span<const float>(std::uint32_t frame)>& features,
            msg::TraversalChunk& message) const;

 private:
  static constexpr std::uint64_t kFloats = msg::MAX_CHUNK / sizeof(float);  // in a full chunk
  static std::uint32_t chunk_of(std::uint64_t at) { return static_cast<std::uint32_t>(at / kFloats); }

  std::uint64_t frames_, width_;
};

/// Fetches the positions and features of consecutive frames: says what to ask for, and takes chunks in any order and as
/// often as they come. Publishes nothing itself.
class Transfer {
 public:
  struct What {
    std::uint64_t hash = 0;  ///< of the traversal
    std::uint32_t frames = 0;
    std::uint32_t dimension = 0;  ///< D
    std::uint32_t first = 0;      ///< frames first .. first + count - 1 of the traversal
    std::uint32_t count = 0;      ///< 0: up to the last frame
  };
  using Taken = citylearn::Taken;

  explicit Transfer(const What& what);

  /// kNotWanted: of another traversal or dimension, of other frames, or taken already. kDamaged: of another
  /// number of frames or bytes than it should be, or with numbers that are not finite (a position may be NaN); nothing
  /// of it is used.
  Taken take(const msg::TraversalChunk& chunk);
  /// Returns whether the chunk belongs to what is still missing.
  bool wants(const msg::TraversalChunk& chunk) const;
  bool complete() const { return chunks_.complete(); }
  std::uint32_t missing() const { return chunks_.missing(); }
  const What& what() const { return what_; }

  /// Returns when a request should go out (RequestTimer).
  Clock::time_point due() const { return timer_.due(); }
  /// Fills all of a request but its header and environment, and returns true, when one is due.
  bool ask(Clock::time_point now, msg::TraversalRequest& request);

  std::vector<float> positions;  ///< count, metres; NaN where unknown
  std::vector<float> features;   ///< count x D, frame-major

 private:
  bool sound(const msg::TraversalChunk& chunk) const;

  What what_;
  ChunkLayout layout_;
  std::uint32_t first_chunk_ = 0;
  ChunkSet chunks_;  ///< from first_chunk_ on
  RequestTimer timer_;
};

}  // namespace citylearn
