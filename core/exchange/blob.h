// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <span>
#include <utility>
#include <vector>

#include "core/util/types.h"
#include "idl/common.h"

// Large data is sent in chunks of MAX_CHUNK bytes. All but the last are full; empty data is one empty chunk. The
// classes below know which chunks have come, what to request next and when to repeat a request. Their users supply the
// messages.

namespace citylearn {

/// Returns the number of chunks for this many bytes.
constexpr std::uint32_t chunk_count(std::uint64_t bytes) {
  return static_cast<std::uint32_t>(std::max<std::uint64_t>(1, (bytes + msg::MAX_CHUNK - 1) / msg::MAX_CHUNK));
}
/// Returns the bytes of one chunk; 0 beyond the last.
constexpr std::size_t chunk_size(std::uint32_t chunk, std::uint64_t bytes) {
  const std::uint64_t before = std::uint64_t{chunk} * msg::MAX_CHUNK;
  return before >= bytes ? 0 : std::min<std::uint64_t>(bytes - before, msg::MAX_CHUNK);
}
/// Returns that part of `bytes` which one chunk carries.
template <class Byte>
std::span<const Byte> chunk_of(std::span<const Byte> bytes, std::uint32_t chunk) {
  return bytes.subspan(std::size_t{chunk} * msg::MAX_CHUNK, chunk_size(chunk, bytes.size()));
}

/// Decides when a request goes out: at once in the beginning and when all that was asked for has come, else after
/// `retry` without an answer.
class RequestTimer {
 public:
  static constexpr int kDefaultTries = 6;  ///< for something that is waited for

  /// `most_tries`: requests in a row without an answer before it gives up; 0: it never does.
  explicit RequestTimer(std::chrono::milliseconds retry, int most_tries = 0) : retry_(retry), most_tries_(most_tries) {}

  Clock::time_point due() const { return due_; }
  bool is_due(Clock::time_point now) const { return now >= due_; }
  bool gave_up(Clock::time_point now) const { return most_tries_ > 0 && tries_ >= most_tries_ && is_due(now); }
  /// Notes that a request went out that brings at most so many answers.
  void sent(Clock::time_point now, std::size_t answers) {
    expected_ = answers;
    ++tries_;
    due_ = now + retry_;
  }
  /// Notes that one of them came.
  void answered(Clock::time_point now) {
    tries_ = 0;
    if (expected_ > 0) --expected_;
    due_ = expected_ > 0 ? now + retry_ : Clock::time_point{};
  }
  /// Makes the timer due, because there is something new to ask for.
  void ask_now() { due_ = {}; }

 private:
  std::chrono::milliseconds retry_;
  int most_tries_, tries_ = 0;
  std::size_t expected_ = 0;
  Clock::time_point due_{};
};

enum class Taken { kYes, kNotWanted, kDamaged };

/// Puts bytes together from their chunks. They may come in any order and more than once.
class Blob {
 public:
  explicit Blob(std::uint64_t total_bytes)
      : bytes_(total_bytes), here_(chunk_count(total_bytes), false), missing_(here_.size()) {}

  /// Returns kDamaged when the chunk has another size than it should have.
  Taken take(std::uint32_t chunk, std::span<const std::uint8_t> data);
  std::uint64_t total_bytes() const { return bytes_.size(); }
  bool complete() const { return missing_ == 0; }
  /// Returns the first `most` chunks that are missing.
  std::vector<std::uint32_t> first_missing(std::size_t most) const;
  /// Hands over the bytes, once complete.
  Bytes release() { return std::move(bytes_); }

 private:
  Bytes bytes_;
  std::vector<bool> here_;
  std::size_t missing_;
  std::uint32_t first_missing_ = 0;
};

}  // namespace citylearn
