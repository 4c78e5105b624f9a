// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "core/wire/node.h"
#include "core/recording/mcap.h"

namespace citylearn {

/// Plays recorded Trajectories to a learner (policy_service --role learner) as the one actor that it hears: addressed
/// to it, numbered anew, sent again until acknowledged and never more than it has room for. It serves no env_service,
/// so that other actors may work beside it. Parameters that acted and are newer than the learner's are called its
/// newest; the probabilities are the recorded ones. Used by one thread.
class TrajectoryReplay {
 public:
  /// `node` must outlive it. Throws Error when a file is none.
  TrajectoryReplay(Node& node, std::vector<std::string> files);

  /// Does what there is to do; to be called whenever something may have come, and at due(). False when the learner has
  /// all, or has ended its training. Throws Error when the recording does not fit the learner, or it takes nothing.
  bool turn();
  Clock::time_point due() const { return due_; }

  std::uint64_t acknowledged() const { return acknowledged_; }
  bool learner_ended() const { return ended_; }

 private:
  void hear();
  void meet(const msg::LearnerInfo& info);
  void on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement);
  bool fetch();
  void require_fits(const msg::Trajectory& trajectory) const;
  void send();
  void send_status();

  Node& node_;
  const std::vector<std::string> files_;
  std::size_t files_opened_ = 0;
  std::unique_ptr<McapReader> reader_;
  bool read_all_ = false;
  std::set<std::tuple<std::string, std::uint64_t, std::uint64_t, std::uint64_t>> seen_;  // sent twice when recorded

  msg::LearnerInfo info_;  // of the learner; incarnation 0: none yet
  bool ended_ = false;
  std::uint64_t number_ = 0, sent_ = 0, acknowledged_ = 0, limit_ = 0;
  std::deque<msg::Trajectory> unacknowledged_;  // acknowledged_ + 1 .. number_
  Clock::time_point again_, progress_, next_status_, due_;
  msg::LearnerInfo heard_;
  msg::TrajectoryAcknowledgement acknowledgement_;
  msg::ActorStatus status_;
};

}  // namespace citylearn
