// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "policy_service/ranks/message_stream.h"
#include "policy_service/ranks/rank_group.h"

namespace citylearn {

struct RosterOptions {
  int rank = 0, ranks = 1;
  std::string rendezvous;                           ///< HOST:PORT; a process on HOST coordinates, or knows who does
  std::string identity;                             ///< JSON object: what must be the same in all ranks
  std::chrono::milliseconds patience = kRankStart;  ///< until ranks that do not come at the start are an error
};

/// A meeting as all its members have it.
struct RosterMeeting {
  RankMeeting meeting;
  std::uint64_t number = 0;
  std::vector<std::string> incarnations;  ///< of the members
  std::vector<std::uint64_t> tags;        ///< what each member arrived with
};

/// Keeps the ranks of one training in touch over TCP, in a thread of its own: it introduces this one to the
/// coordinator, looks for the next one when that is lost, and is the coordinator when it is this one's turn
/// (docs/decisions/0021-ranks.md). All methods are for one other thread.
class Roster {
 public:
  /// Throws Error when the rendezvous is not an address.
  explicit Roster(const RosterOptions& options);
  ~Roster();
  Roster(const Roster&) = delete;
  Roster& operator=(const Roster&) = delete;

  /// Waits for the next meeting. `tag` goes to all its members. Calls `idle` every 50 ms at most. Throws Error when
  /// this rank is refused or others do not come, and what `idle` throws.
  RosterMeeting arrive(const RankArrival& arrival, std::uint64_t tag, const std::function<void()>& idle);
  /// Tells the members of a meeting a value.
  void set(std::uint64_t meeting, const std::string& key, const std::vector<char>& value);
  /// Waits for a value until the deadline. Returns false when it has not come.
  bool get(std::uint64_t meeting, const std::string& key, std::chrono::steady_clock::time_point deadline,
           std::vector<char>& value);
  /// Returns whether the last meeting's update counts.
  bool vote(bool yes, const std::function<void()>& idle);
  /// Says that this rank has finished.
  void leave();
  /// Returns the address of this host that the others see.
  const std::string& host() const;

 private:
  class Thread;
  std::unique_ptr<Thread> thread_;
};

}  // namespace citylearn
