// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>

#include "core/exchange/log_sender.h"
#include "core/wire/node.h"

namespace citylearn {

/// Keeps an actor's trajectories for one incarnation of a learner until they are acknowledged, and sends them as far as
/// the learner has room, as a LogSender decides. Used by one thread.
class TrajectoryOutbox {
 public:
  explicit TrajectoryOutbox(Node& node) : node_(node) {}

  /// Begins a list for this process of a learner behind a number: the learner has those up to it from this process.
  void begin(const msg::Header& learner, std::uint64_t acknowledged);
  /// Adds a trajectory, for the caller to fill in, and numbers it.
  msg::Trajectory& add();
  /// Sends what there is room for, and the first ones again when it is time to.
  void send_due();
  /// Reads all fields of the acknowledgement but its receiver.
  LogSender::Acknowledged acknowledge(const msg::LogAcknowledgement& acknowledgement);

  std::uint64_t last() const { return log_.last(); }  ///< number of the last trajectory
  std::uint64_t sent() const { return log_.sent(); }  ///< number of the last one that was sent
  std::uint64_t acknowledged() const { return log_.acknowledged(); }
  std::size_t unacknowledged() const { return waiting_.size(); }

 private:
  void show_queue();

  Node& node_;
  LogSender log_{LogOptions()};
  std::uint64_t stream_ = 0;
  std::deque<msg::Trajectory> waiting_;  ///< acknowledged() + 1 .. last()
};

}  // namespace citylearn
