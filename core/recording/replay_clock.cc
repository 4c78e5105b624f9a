// SPDX-License-Identifier: Apache-2.0
#include "core/recording/replay_clock.h"

#include <algorithm>

namespace citylearn {
namespace {

constexpr double kMaxWait = 1e9;                             // seconds: what the clock bears
constexpr Clock::time_point kOrigin{std::chrono::hours(1)};  // of now(): a time_point of 0 means never

Clock::duration duration_of(double seconds) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(std::min(seconds, kMaxWait)));
}

}  // namespace

/// Returns the position that the clock alone would have reached, and beyond the end how long that is ago.
double ReplayClock::reached() const {
  return base_at_ + std::chrono::duration<double>(Clock::now() - *base_).count() * (ended_ ? 1 : speed_);
}

Clock::time_point ReplayClock::now() const {
  const std::lock_guard lock(mutex_);
  return kOrigin + duration_of(ended_ ? reached() : position_);
}

Clock::time_point ReplayClock::due(std::int64_t position) {
  const std::lock_guard lock(mutex_);
  const double at = 1e-9 * static_cast<double>(position);
  if (!base_) {  // the first one is due at once
    base_ = Clock::now();
    base_at_ = at;
  }
  position_ = std::max(position_, speed_ == 0 ? at : std::min(reached(), at));
  return speed_ == 0 ? Clock::time_point::min() : *base_ + duration_of((at - base_at_) / speed_);
}

void ReplayClock::delay(Clock::duration time) {
  const std::lock_guard lock(mutex_);
  if (base_) *base_ += time;
}

void ReplayClock::end(std::int64_t position) {
  const std::lock_guard lock(mutex_);
  if (ended_) return;
  position_ = base_at_ = std::max(position_, 1e-9 * static_cast<double>(position));
  base_ = Clock::now();
  ended_ = true;
}

}  // namespace citylearn
