// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <mutex>
#include <optional>

#include "core/util/types.h"

namespace citylearn {

/// The time of recordings that are played: says when their messages are due. Used by one thread, but for now().
class ReplayClock {
 public:
  /// `speed` is relative to the recording; 0: as fast as readers can follow.
  explicit ReplayClock(double speed) : speed_(speed) {}

  /// Returns a time that goes as the recording does, and after the end as the machine's clock does. It tells whether a
  /// service of the recording is silent. May be used by any thread.
  Clock::time_point now() const;
  /// Returns when the next message, at `position` (nanoseconds since the first one), is to be played. Call it again at
  /// the latest some milliseconds later, so that now() goes on.
  Clock::time_point due(std::int64_t position);
  /// Delays all messages that follow by this time, because readers were waited for.
  void delay(Clock::duration time);
  /// Notes that all messages were played, the last of them at `position`.
  void end(std::int64_t position);

 private:
  double reached() const;

  const double speed_;
  mutable std::mutex mutex_;
  double position_ = 0;  // seconds
  bool ended_ = false;
  std::optional<Clock::time_point> base_;  // when the position was base_at_; none before the first message
  double base_at_ = 0;                     // seconds
};

}  // namespace citylearn
