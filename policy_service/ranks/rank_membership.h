// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "core/exchange/incumbent.h"
#include "core/exchange/message_order.h"
#include "idl/rank.h"

namespace citylearn {

/// The ranks that make one update together, in rising order.
struct RankCall {
  struct Member {
    std::uint64_t incarnation = 0;
    int rank = 0;
    std::uint64_t updates = 0;
    bool newcomer = false;  ///< has another history than the others
  };
  std::uint64_t id = 0, connected = 0;
  std::vector<Member> members;
};

/// Decides which ranks make an update together and whether it counts, from what all of them say in their RankStatus
/// (docs/decisions/0021-ranks.md has the rules). It has neither network nor clock. Used by one thread at a time.
class RankMembership {
 public:
  struct Options {
    int rank = 0, ranks = 1;
    std::string host, identity;  ///< `identity`: JSON object that must be the same in all ranks
  };
  /// `incarnation`: as in the header of this process's messages.
  RankMembership(const Options& options, std::uint64_t incarnation, Clock::time_point now);

  /// Takes a status of any process.
  void take(const msg::RankStatus& status, Clock::time_point now);
  /// Does what is due.
  void tick(Clock::time_point now);
  /// Returns what this rank says now, all but the header.
  const msg::RankStatus& status() const { return status_; }
  /// Returns why this rank cannot take part; empty: it can.
  const std::string& refusal() const { return refusal_; }

  /// Says that this rank has an update to share. `connected`: the call since which it is connected to all its members.
  void arrive(std::uint64_t updates, std::uint64_t connected);
  /// Returns the call that it takes part in since it arrived; nothing: it waits.
  const std::optional<RankCall>& call() const { return call_; }
  /// Says where the other members of the call reach this rank.
  void set_connection(const std::vector<char>& address) { status_.connection().assign(address.begin(), address.end()); }
  /// Returns where a member of the call is reached: null: not yet known.
  const std::vector<std::uint8_t>* connection_of(std::uint64_t incarnation) const;
  /// Returns whether all members of the call are heard.
  bool all_here() const;
  /// Says whether this rank has the sum of the call.
  void vote(bool yes);
  /// Returns whether the call counts; nothing: it waits.
  std::optional<bool> decision() const { return decision_; }
  /// Says that this rank has finished.
  void leave() { status_.leaves(true); }
  /// Returns the ranks below Options::ranks that are not heard.
  std::vector<int> missing() const;

 private:
  using Status = msg::RankStatus;
  struct Peer {
    Incumbent incumbent;
    MessageOrder order;
    Status status;
    Clock::time_point came{};
  };
  bool is_twin(const Status& status, Clock::time_point now);
  bool fits(const Status& status, Clock::time_point now);
  void pass_to(Clock::time_point now);
  void look(Clock::time_point now);
  void find_coordinator(Clock::time_point now);
  void coordinate(Clock::time_point now);
  void decide();
  void make_call(Clock::time_point now);
  void obey(const Status& coordinator);
  /// Returns what orders groups: whether one has shared updates, its size as heard, its coordinator.
  std::tuple<bool, std::size_t, std::uint64_t> weight(std::uint64_t coordinator) const;
  std::vector<const Status*> followers(std::uint64_t coordinator) const;
  bool coordinates() const { return status_.coordinator() == incarnation_; }

  const Options options_;
  const std::uint64_t incarnation_;
  Status status_;
  std::map<std::uint32_t, Peer> peers_;          ///< by rank, but this one
  std::map<std::uint64_t, const Status*> here_;  ///< by incarnation: ranks that are heard and hear this one, and itself
  Clock::time_point last_tick_, called_at_{}, settled_{}, other_heard_{}, twin_since_{}, resumed_{};
  std::uint64_t twin_ = 0;  ///< incarnation of another process of this rank
  std::string refusal_;
  std::optional<RankCall> call_;
  std::optional<bool> decision_;
  std::uint64_t next_history_ = 0;  ///< if the call counts
};

/// Returns where two identities differ first, "trainer.steps is 4096, that of the others 8192"; empty when they do not.
std::string identity_difference(const std::string& ours, const std::string& theirs);

}  // namespace citylearn
