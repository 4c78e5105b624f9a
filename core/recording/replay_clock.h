// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>

#include "core/util/types.h"

namespace citylearn {

/// The position and speed of a playback of recordings.
struct ReplayState {
  double position = 0;  ///< seconds since the first message, as RecordingClock measures them
  double speed = 1;     ///< relative to the recording; 0: as fast as readers can follow
  bool paused = false;
  bool seeking = false;  ///< on its way to a position, as fast as readers can follow
  bool ended = false;    ///< all messages were played
};

/// The time of recordings that are played: says when their messages are due. It can be paused, made faster or slower,
/// and sent ahead, but not back: what was played was heard. Used by one thread, but for the methods of the first group.
class ReplayClock {
 public:
  explicit ReplayClock(const ReplayState& begin = {}) : state_(begin) {
    state_.position = 0;
    seek(begin.position);
  }

  // Any thread.
  void pause(bool paused);
  void set_speed(double speed);
  /// Plays everything up to `seconds` as fast as readers can follow, also while paused. An earlier position than the
  /// present one changes nothing.
  void seek(double seconds);
  ReplayState state() const;
  /// Returns a time that goes as the position does, and after the end as the machine's clock does. It tells whether a
  /// service of the recording is silent.
  Clock::time_point now() const;

  /// Returns when the next message, at `position` (nanoseconds), is to be played: time_point::max() while paused. Call
  /// it again at the latest some milliseconds later, as the answer may change.
  Clock::time_point due(std::int64_t position);
  /// Delays all messages that follow by this time, because readers were waited for.
  void delay(Clock::duration time);
  /// Notes that all messages were played, the last of them at `position`.
  void end(std::int64_t position);

 private:
  double reached(Clock::time_point now) const;
  void set_base(std::optional<double> at = {});

  mutable std::mutex mutex_;
  ReplayState state_;
  std::optional<double> target_;           // seconds
  std::optional<Clock::time_point> base_;  // when the position was base_at_; none before the first message
  double base_at_ = 0;                     // seconds
};

}  // namespace citylearn
