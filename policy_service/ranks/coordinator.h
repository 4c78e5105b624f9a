// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/util/types.h"

namespace citylearn {

inline constexpr int kRankProtocol = 1;  ///< of the messages between ranks

/// Decides which ranks make an update together and whether it counts (docs/decisions/0021-ranks.md). Every rank's
/// process has one; the one that serves has all ranks as its members, its own included. It remembers nothing of an
/// update: what the members ask says enough, so that another process's coordinator continues where one was lost. It
/// uses neither sockets nor clock. Used by one thread.
class Coordinator {
 public:
  using Json = nlohmann::json;
  /// Sends a message to a connection; without a message, closes it.
  using Send = std::function<void(int connection, const Json* message)>;

  /// `incarnation` names this process among all that ever take part.
  Coordinator(std::string incarnation, Send send);
  ~Coordinator();

  /// Returns whether it has members: the first one is this process's own rank.
  bool serving() const { return !members_.empty(); }
  /// Takes in a rank that introduces itself, or refuses it.
  void introduce(int connection, const Json& hello, Clock::time_point now);
  /// Takes in another message of a member.
  void receive(int connection, const Json& message, Clock::time_point now);
  /// Goes on without a member whose connection is over.
  void lose(int connection, Clock::time_point now);
  /// Goes on without members that are silent, and does what is due.
  void tick(Clock::time_point now);
  /// Shows all members that it is there.
  void beat();
  /// Restarts the time-outs of all members, because this process itself stood still.
  void reset_silence_timers(Clock::time_point now);
  /// Sends all members to another coordinator.
  void hand_over(const std::string& address);
  /// Returns whether another coordinator's group, as its probe describes it, has precedence over this one.
  bool yields_to(const Json& probe) const;
  Json probe(const std::string& address) const;

 private:
  struct Member {
    int rank = 0;
    std::string incarnation, address;
    Clock::time_point heard{};
    std::optional<std::uint64_t> vote;  ///< the meeting that it votes on
    bool yes = false;
    std::vector<char> arrival;  ///< what it arrived with, as CBOR; empty: it has not
    std::uint64_t committed = 0, seen = 0;
  };

  std::string refusal(const Json& hello) const;
  void welcome(int connection, const Json& hello, Clock::time_point now);
  void remove(int connection, const std::string& why);
  void send_members();
  void decide(Clock::time_point now);
  void vote();
  void meet();
  std::uint64_t established() const;  ///< the last meeting that counted; 0: none yet

  const std::string incarnation_;
  const Send send_;
  std::map<int, Member> members_;  ///< by connection
  /// Hellos of a rank whose earlier process may still live.
  std::map<int, std::vector<char>> contested_;
  std::string identity_;            ///< of all members
  int ranks_ = 0;                   ///< at the start
  std::set<std::string> expected_;  ///< incarnations that may come from the coordinator that was lost
  Clock::time_point settled_{};     ///< nothing is decided before, so that they can
  std::size_t met_ = 0;             ///< members of the last meeting
};

/// Returns where two identities differ first, "trainer.steps is 4096, here 8192"; empty when they do not.
std::string identity_difference(const nlohmann::json& theirs, const nlohmann::json& ours);

}  // namespace citylearn
