// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/trajectory_outbox.h"

#include <algorithm>

namespace citylearn {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kShortestInterval{200}, kLongestInterval{2000};
constexpr std::size_t kResentAtOnce = 16;
constexpr std::uint64_t kMostInFlight = 48;  // a writer's history is little deeper

}  // namespace

/// `waited` is how long the last acknowledgement took. A learner does not acknowledge while it learns, so one that
/// takes long for it is given as long the next time.
void TrajectoryOutbox::schedule_resend(Clock::duration waited) {
  waits_since_ = Clock::now();
  interval_ = std::clamp<Clock::duration>(2 * waited, kShortestInterval, kLongestInterval);
  resend_ = waits_since_ + interval_;
}

/// Its capacity is the room that the learner gives.
void TrajectoryOutbox::show_queue() {
  node_.metrics().set_queue("trajectories", waiting_.size(), std::max(limit_, acknowledged_) - acknowledged_);
}

msg::Trajectory& TrajectoryOutbox::add() {
  if (waiting_.empty()) schedule_resend(waited_);
  msg::Trajectory& trajectory = waiting_.emplace_back();
  trajectory.number() = ++number_;
  show_queue();
  return trajectory;
}

void TrajectoryOutbox::send_due() {
  const auto publish = [&](std::uint64_t number) {
    node_.publish(waiting_[static_cast<std::size_t>(number - acknowledged_ - 1)]);
  };
  const std::uint64_t until = std::min({number_, limit_, acknowledged_ + kMostInFlight});
  while (sent_ < until) publish(++sent_);
  const Clock::time_point now = Clock::now();
  if (sent_ <= acknowledged_ || now < resend_) return;
  for (std::uint64_t number = acknowledged_ + 1; number <= std::min(sent_, acknowledged_ + kResentAtOnce); ++number) {
    publish(number);
    ++node_.traffic.resent;
  }
  interval_ = std::min<Clock::duration>(2 * interval_, kLongestInterval);
  resend_ = now + interval_;
}

TrajectoryOutbox::Result TrajectoryOutbox::acknowledge(std::uint64_t number, std::uint64_t limit) {
  if (number > number_) return Result::kNeverSent;
  if (number < acknowledged_) return Result::kOutdated;
  limit_ = limit;
  if (number > acknowledged_) {
    for (; acknowledged_ < number; ++acknowledged_) waiting_.pop_front();
    sent_ = std::max(sent_, acknowledged_);
    schedule_resend(waited_ = Clock::now() - waits_since_);
  }
  show_queue();
  return Result::kAccepted;
}

}  // namespace citylearn
