// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "policy_service/ranks/rank_group.h"
#include "policy_service/ranks/roster.h"

namespace citylearn {

/// Ranks in processes of their own, on any hosts: gloo adds, a Roster knows who is there.
class GlooGroup : public RankGroup {
 public:
  /// Calls `idle` every 50 ms at most while it waits; what that throws ends the waiting. Throws Error as Roster does.
  GlooGroup(const RosterOptions& options, std::function<void()> idle);
  ~GlooGroup() override;

  RankMeeting meet(const RankArrival& arrival) override;
  void sum(std::span<float> values) override;
  bool agree(bool succeeded) override;
  void leave() override;

 private:
  class Connections;

  const std::function<void()> idle_;
  Roster roster_;
  RosterMeeting now_;
  std::unique_ptr<Connections> connections_;  ///< of the members, kept while these stay the same
  std::uint64_t connected_at_ = 0;            ///< the meeting at which they were made; 0: none
  std::vector<std::string> connected_;        ///< incarnations
};

}  // namespace citylearn
