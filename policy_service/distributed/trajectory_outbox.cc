// SPDX-License-Identifier: Apache-2.0
#include "policy_service/distributed/trajectory_outbox.h"

#include <algorithm>

namespace citylearn {

void TrajectoryOutbox::begin(const msg::Header& learner, std::uint64_t acknowledged) {
  waiting_.clear();
  stream_ = learner.incarnation();
  // A writer's history is little deeper than the credit window.
  log_ = LogSender({.resend_window = 16, .send_window = 0, .credit_window = 48}, {learner.sender().c_str()},
                   acknowledged + 1);
}

/// Updates the queue's metrics. Its capacity is the room that the learner gives.
void TrajectoryOutbox::show_queue() {
  const std::uint64_t acknowledged = log_.acknowledged();
  node_.metrics().set_queue("trajectories", waiting_.size(), std::max(log_.limit(), acknowledged) - acknowledged);
}

msg::Trajectory& TrajectoryOutbox::add() {
  msg::Trajectory& trajectory = waiting_.emplace_back();
  log_.add();
  show_queue();
  return trajectory;
}

void TrajectoryOutbox::send_due() {
  while (const auto next = log_.next(Clock::now())) {
    msg::Trajectory& trajectory = waiting_[static_cast<std::size_t>(next->number - log_.acknowledged() - 1)];
    trajectory.log() = log_.position(next->number, stream_);
    node_.publish(trajectory);
    if (next->again) ++node_.traffic.resent;
  }
}

LogSender::Acknowledged TrajectoryOutbox::acknowledge(const msg::LogAcknowledgement& acknowledgement) {
  const LogSender::Acknowledged result = log_.acknowledge(acknowledgement, Clock::now());
  while (waiting_.size() > log_.kept()) waiting_.pop_front();
  show_queue();
  return result;
}

}  // namespace citylearn
