// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

#include "core/wire/node.h"

namespace citylearn {

/// Keeps an actor's trajectories for one incarnation of a learner until they are acknowledged, and sends them as far as
/// the learner has room; again while no acknowledgement arrives. Used by one thread.
class TrajectoryOutbox {
 public:
  explicit TrajectoryOutbox(Node& node) : node_(node) {}

  /// Begins behind this number: the learner has those up to it from this process.
  void continue_after(std::uint64_t number) { number_ = sent_ = acknowledged_ = limit_ = number; }
  /// Adds a trajectory, for the caller to fill in, and numbers it.
  msg::Trajectory& add();
  /// Sends what there is room for, and the first ones again when it is time to.
  void send_due();

  enum class Result { kAccepted, kOutdated, kNeverSent };
  /// Takes in that all trajectories up to `number` arrived and that there is room up to `limit`.
  Result acknowledge(std::uint64_t number, std::uint64_t limit);

  std::uint64_t last() const { return number_; }  ///< number of the last trajectory
  std::uint64_t sent() const { return sent_; }    ///< number of the last one that was sent
  std::uint64_t acknowledged() const { return acknowledged_; }
  std::size_t unacknowledged() const { return waiting_.size(); }

 private:
  void schedule_resend(Clock::duration waited);
  void show_queue();

  Node& node_;
  std::uint64_t number_ = 0, acknowledged_ = 0, sent_ = 0, limit_ = 0;
  std::deque<msg::Trajectory> waiting_;  ///< acknowledged_ + 1 .. number_
  Clock::time_point waits_since_{}, resend_{};
  Clock::duration waited_{}, interval_{};
};

}  // namespace citylearn
