// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/trajectory_outbox.h"

#include <algorithm>

namespace citylearn {

void TrajectoryOutbox::begin(const std::string& learner, std::uint64_t acknowledged) {
  waiting_.clear();
  // A writer's history is little deeper than the credit window.
  log_ = LogSender({.resend_window = 16, .send_window = 0, .credit_window = 48}, {learner}, acknowledged + 1);
}

/// Updates the queue's metrics. Its capacity is the room that the learner gives.
void TrajectoryOutbox::show_queue() {
  const std::uint64_t acknowledged = log_.acknowledged();
  node_.metrics().set_queue("trajectories", waiting_.size(), std::max(log_.limit(), acknowledged) - acknowledged);
}

msg::Trajectory& TrajectoryOutbox::add() {
  msg::Trajectory& trajectory = waiting_.emplace_back();
  trajectory.number() = log_.add();
  show_queue();
  return trajectory;
}

void TrajectoryOutbox::send_due() {
  while (const auto next = log_.next(Clock::now())) {
    node_.publish(waiting_[static_cast<std::size_t>(next->number - log_.acknowledged() - 1)]);
    if (next->again) ++node_.traffic.resent;
  }
}

LogSender::Acknowledged TrajectoryOutbox::acknowledge(const msg::TrajectoryAcknowledgement& acknowledgement) {
  const LogSender::Acknowledged result = log_.acknowledge(
      {.from = acknowledgement.header(), .number = acknowledgement.number(), .limit = acknowledgement.limit()},
      Clock::now());
  while (waiting_.size() > log_.kept()) waiting_.pop_front();
  show_queue();
  return result;
}

}  // namespace citylearn
