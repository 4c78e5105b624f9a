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
double ReplayClock::reached(Clock::time_point now) const {
  if (!base_ || state_.paused || (state_.speed == 0 && !state_.ended)) return base_at_;
  return base_at_ + std::chrono::duration<double>(now - *base_).count() * (state_.ended ? 1 : state_.speed);
}

/// Counts from `at`, or from where it is, from now on.
void ReplayClock::set_base(std::optional<double> at) {
  const Clock::time_point now = Clock::now();
  if (!base_ && !at) return;
  base_at_ = at ? *at : state_.ended ? reached(now) : state_.position;
  base_ = now;
  if (!state_.ended) state_.position = base_at_;
}

void ReplayClock::pause(bool paused) {
  const std::lock_guard lock(mutex_);
  set_base();
  state_.paused = paused;
}

void ReplayClock::set_speed(double speed) {
  const std::lock_guard lock(mutex_);
  set_base();
  state_.speed = speed;
}

void ReplayClock::seek(double seconds) {
  const std::lock_guard lock(mutex_);
  if (seconds <= state_.position || state_.ended) return;
  target_ = seconds;
  state_.seeking = true;
}

ReplayState ReplayClock::state() const {
  const std::lock_guard lock(mutex_);
  return state_;
}

Clock::time_point ReplayClock::now() const {
  const std::lock_guard lock(mutex_);
  return kOrigin + duration_of(state_.ended ? reached(Clock::now()) : state_.position);
}

Clock::time_point ReplayClock::due(std::int64_t position) {
  const std::lock_guard lock(mutex_);
  constexpr Clock::time_point kDueNow = Clock::time_point::min();
  const double at = 1e-9 * static_cast<double>(position);
  if (!base_) set_base(target_ ? 0 : at);  // the first one is due at once
  if (target_ && at <= *target_) {
    state_.position = std::max(state_.position, at);
    return kDueNow;
  }
  if (target_) {
    set_base(*target_);
    target_.reset();
    state_.seeking = false;
  }
  if (state_.paused) return Clock::time_point::max();
  if (state_.speed == 0) {
    set_base(std::max(state_.position, at));
    return kDueNow;
  }
  state_.position = std::max(state_.position, std::min(reached(Clock::now()), at));
  return *base_ + duration_of((at - base_at_) / state_.speed);
}

void ReplayClock::delay(Clock::duration time) {
  const std::lock_guard lock(mutex_);
  if (base_) *base_ += time;
}

void ReplayClock::end(std::int64_t position) {
  const std::lock_guard lock(mutex_);
  if (state_.ended) return;
  set_base(std::max(state_.position, 1e-9 * static_cast<double>(position)));
  target_.reset();
  state_.seeking = false;
  state_.ended = true;
}

}  // namespace citylearn
