// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

namespace citylearn {

/// Thrown by RankGroup::sum() when a member is killed or silent.
struct RankLost : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// The message of a rank that comes to a meeting.
struct RankArrival {
  std::uint64_t updates = 0;  ///< that it has made
  std::string news;           ///< for all members
  std::string progress;       ///< for all members, if it is the one that the others follow
};

/// The ranks that make one update together, in rising order.
struct RankMeeting {
  struct Member {
    int rank = 0;
    std::uint64_t updates = 0;
    bool newcomer = false;  ///< did not take part in the last update of those that did
    std::string news;
  };
  std::vector<Member> members;
  std::size_t mine = 0;    ///< the caller's place in `members`
  std::size_t leader = 0;  ///< place of the member that has made the most updates; the first one of several
  std::string progress;    ///< of the leader

  /// Returns whether a member must take over how far the leader is, and its own work is lost.
  bool behind(std::size_t member) const {
    return members[member].updates < members[leader].updates || (members[member].newcomer && !members[leader].newcomer);
  }
  /// Returns the leader's place: newcomers follow if there are others.
  static std::size_t leader_of(std::span<const Member> members) {
    std::size_t leader = 0;
    for (std::size_t i = 1; i < members.size(); ++i) {
      const Member &best = members[leader], &one = members[i];
      if (one.newcomer != best.newcomer ? best.newcomer : one.updates > best.updates) leader = i;
    }
    return leader;
  }
};

/// The processes that share the work of one training. An update is: meet(), any number of sum(), agree(). Where that
/// says no, all repeat it, from meet(). Used by one thread.
class RankGroup {
 public:
  virtual ~RankGroup() = default;
  /// Waits until every living rank is here; those that come or come back take part from the next meeting on. Throws
  /// Error when this rank is refused, and what ends a waiting.
  virtual RankMeeting meet(const RankArrival& arrival) = 0;
  /// Replaces the values by their sums over the members of the last meeting, bit for bit the same for all of them. All
  /// call it with as many values. Throws RankLost.
  virtual void sum(std::span<float> values) = 0;
  /// Returns whether all living members of the last meeting say that they succeeded: the update then counts.
  virtual bool agree(bool succeeded) = 0;
  /// Says that this rank has finished: nobody waits for it, and nobody can join it.
  virtual void leave() = 0;
};

}  // namespace citylearn
