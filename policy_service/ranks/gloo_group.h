// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "policy_service/ranks/rank_group.h"
#include "policy_service/ranks/rank_node.h"

namespace citylearn {

/// Ranks in processes of their own, on any hosts: gloo adds, a RankNode knows who is there.
class GlooGroup : public RankGroup {
 public:
  /// Calls `idle` every 50 ms at most while it waits; what that throws ends the waiting. Throws Error as RankNode does.
  GlooGroup(const RankOptions& options, std::function<void()> idle);
  ~GlooGroup() override;

  RankMeeting meet(const RankArrival& arrival) override;
  void sum(std::span<float> values) override;
  bool agree(bool succeeded) override;
  void leave() override;

 private:
  class Connections;
  /// Calls `use` with the connections of the call, once they are there. Throws RankLost.
  template <class Use>
  void with_connections(Use use);

  const std::function<void()> idle_;
  const std::string interface_;
  RankNode node_;
  RankCall call_;
  std::unique_ptr<Connections> connections_;  ///< of the members, kept while these stay the same
  std::uint64_t connected_ = 0;               ///< the call at which they were made; 0: none
  std::vector<std::uint64_t> members_;        ///< incarnations
};

}  // namespace citylearn
