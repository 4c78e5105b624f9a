// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "core/exchange/incumbent.h"
#include "core/recording/mcap.h"
#include "core/wire/node.h"
#include "policy_service/distributed/trajectory_outbox.h"

namespace citylearn {

/// Plays recorded Trajectories to a learner (policy_service --role learner) as one more actor: addressed to it,
/// numbered anew, sent again until acknowledged, and never more than it has room for. It serves no env_service, so
/// other actors may work beside it. A version of the parameters newer than the learner's is replaced by its newest; the
/// probabilities are the recorded ones. Used by one thread.
class TrajectoryReplay {
 public:
  /// `node` must outlive it. Throws Error when a file is not a recording.
  TrajectoryReplay(Node& node, std::vector<std::string> files);

  /// Takes and sends what can be taken and sent now. Call it whenever something may have come, and at due(). Returns
  /// false when the learner has all of it or has ended its training. Throws Error when the recording does not fit the
  /// learner or the learner accepts nothing.
  bool poll();
  Clock::time_point due() const { return due_; }

  std::uint64_t acknowledged() const { return outbox_.acknowledged(); }
  bool learner_ended() const { return ended_; }

 private:
  void take_messages();
  void on_info(const msg::LearnerInfo& info);
  void on_acknowledgement(const msg::TrajectoryAcknowledgement& acknowledgement);
  bool fetch();
  void require_fits(const msg::Trajectory& trajectory) const;
  void send_status();

  Node& node_;
  const std::vector<std::string> files_;
  std::size_t files_opened_ = 0;
  std::unique_ptr<McapReader> reader_;
  std::set<std::tuple<std::string, std::uint64_t, std::uint64_t, std::uint64_t>> seen_;  // sent twice when recorded

  Incumbent learner_;
  msg::LearnerInfo info_;  // of the learner; incarnation 0: none yet
  bool ended_ = false;
  TrajectoryOutbox outbox_;
  Clock::time_point progress_, next_status_, due_;
  msg::LearnerInfo heard_;
  msg::TrajectoryAcknowledgement acknowledgement_;
  msg::ActorStatus status_;
};

}  // namespace citylearn
