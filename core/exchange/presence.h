// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <compare>

#include "core/exchange/timing.h"
#include "core/util/types.h"

namespace citylearn {

/// Remembers when a service was last heard.
class Presence {
 public:
  Presence() = default;
  explicit Presence(Clock::time_point heard) : last_(heard) {}
  void heard(Clock::time_point now) { last_ = now; }
  /// Counts it as gone from now on.
  void forget() { last_ = {}; }
  /// Returns whether it was heard less than kSilence ago.
  bool here(Clock::time_point now) const { return last_ != Clock::time_point{} && now - last_ < kSilence; }
  Clock::time_point last_heard() const { return last_; }
  /// Returns when it will count as gone unless it is heard again.
  Clock::time_point gone_at() const { return last_ + kSilence; }
  auto operator<=>(const Presence&) const = default;

 private:
  Clock::time_point last_{};
};

}  // namespace citylearn
