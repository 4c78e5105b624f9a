// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/wire/node_options.h"
#include "policy_service/ranks/rank_membership.h"

namespace citylearn {

struct RankOptions {
  int rank = 0, ranks = 1;
  std::string identity;                             ///< JSON object: what must be the same in all ranks
  NodeOptions node;                                 ///< of the service; `domain` is that of the ranks
  std::chrono::milliseconds patience = kRankStart;  ///< until ranks that do not come at the start are an error
};

/// Keeps a rank in touch with the others over DDS, in a thread of its own, since its user learns and adds for long. All
/// methods are for one other thread. Those that wait call `idle` every 50 ms at most.
class RankNode {
 public:
  using Idle = std::function<void()>;
  /// Throws Error when its middleware cannot be created.
  explicit RankNode(const RankOptions& options);
  ~RankNode();
  RankNode(const RankNode&) = delete;
  RankNode& operator=(const RankNode&) = delete;

  std::uint64_t incarnation() const;
  /// Waits for the next call, as RankMembership::arrive(). Throws Error when this rank is refused or others do not
  /// come, and what `idle` throws.
  RankCall arrive(std::uint64_t updates, std::uint64_t connected, const Idle& idle);
  /// Returns whether the update of the call counts.
  bool vote(bool yes, const Idle& idle);
  /// Says where the other members of the call reach this rank.
  void set_connection(const std::vector<char>& address);
  /// Waits for where a member is reached. Returns nothing when that does not come in time, or a member is lost.
  std::vector<char> connection_of(std::uint64_t incarnation);
  /// Says that this rank has finished.
  void leave();

 private:
  class Impl;
  const std::unique_ptr<Impl> impl_;
  bool was_called_ = false;
};

}  // namespace citylearn
