// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

namespace citylearn {

/// Turns the times of a recording's messages into its position: nanoseconds since its first message, without leaps of
/// the clock. A leap ahead counts as 10 s, one back as none. Give it every message, in the order of the recording:
/// those that are not played show whether time passed or a clock was set.
class RecordingClock {
 public:
  /// Call it before the first message of each file.
  void begin_file() {
    fresh_ = true;
    leaps_ = 0;
  }
  void follow(std::uint64_t time) {
    const std::uint64_t last = last_.value_or(time);
    const std::uint64_t ahead = time > last ? time - last : 0, back = last > time ? last - time : 0;
    last_ = time;
    const bool another = std::exchange(fresh_, false) && (back > 0 || ahead > kMaxGap);
    if (another) return;  // not the next part of this recording: it follows at once
    if (ahead > kMaxGap || back > kMaxGap) ++leaps_;
    position_ += static_cast<std::int64_t>(std::min(ahead, kMaxGap));
    if (back <= kMaxGap) position_ -= static_cast<std::int64_t>(back);
    length_ = std::max(length_, position_);
  }
  std::int64_t position() const { return position_; }  ///< of the message that came last
  std::int64_t length() const { return length_; }      ///< the largest position
  std::size_t leaps() const { return leaps_; }         ///< of this file

 private:
  static constexpr std::uint64_t kMaxGap = 10'000'000'000;  // in a recording something comes every second

  bool fresh_ = false;                 // nothing of the file was taken yet
  std::optional<std::uint64_t> last_;  // recorded
  std::int64_t position_ = 0, length_ = 0;
  std::size_t leaps_ = 0;
};

}  // namespace citylearn
