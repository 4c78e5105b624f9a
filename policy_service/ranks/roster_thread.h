// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <condition_variable>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <thread>
#include <vector>

#include "core/util/types.h"
#include "policy_service/ranks/coordinator.h"
#include "policy_service/ranks/roster.h"

namespace citylearn {

/// The thread of a Roster: one loop over all its sockets.
class Roster::Thread {
 public:
  using Json = nlohmann::json;
  explicit Thread(const RosterOptions& options);
  ~Thread();

  const std::string& host() const { return own_.host; }
  const std::string& incarnation() const { return incarnation_; }
  /// Sends the coordinator a question, again after each change of coordinator, until an answer of a type comes.
  Json ask(Json question, const std::string& answer, const std::function<void()>& idle);
  void tell(const Json& message);
  bool stored(std::uint64_t meeting, const std::string& key, Clock::time_point deadline, std::vector<char>& value);
  void leave();

  std::mutex user;  ///< held while one asks

 private:
  struct Candidate {
    RankAddress address;
    bool takes_over = false;
  };
  struct Known {
    int rank = 0;
    std::string incarnation, address;
  };
  struct Accepted {
    MessageStream stream;
    Clock::time_point since{};
    std::optional<Json> hello;  ///< waits until this process coordinates, or knows who does
    bool takes_over = false, closing = false;
  };

  void run();
  void wait_for_sockets();
  void serve(Clock::time_point now);
  void take_first(int connection, Accepted& accepted, const Json& message, Clock::time_point now);
  void answer_waiting(Clock::time_point now);
  void coordinate(Clock::time_point now);
  void probe_others(Clock::time_point now);
  void open_front(Clock::time_point now);
  void follow(Clock::time_point now);
  void search(Clock::time_point now);
  void take(const Json& message, Clock::time_point now);
  void joined(const Json& welcome, Clock::time_point now);
  void lost_coordinator(bool silent);
  void resend();
  void fail(const std::string& why, const std::string& remedy);
  void check_patience(Clock::time_point now);

  const RosterOptions options_;
  const std::string incarnation_;
  const Clock::time_point start_ = Clock::now();
  const RankAddress rendezvous_;
  RankAddress own_;
  OwnedSocket listener_, front_, wake_;

  // As a coordinator.
  Coordinator coordinator_;
  std::map<int, Accepted> accepted_;
  int next_connection_ = 0;
  std::unique_ptr<MessageStream> probe_;
  Clock::time_point next_probe_{}, next_front_{}, next_heartbeat_{}, last_turn_{};

  // As a member.
  std::unique_ptr<MessageStream> link_;
  bool is_member_ = false, left_ = false, ever_met_ = false;
  bool kept_ = false;  ///< whether the coordinator took over and has not called a meeting yet
  std::string coordinator_incarnation_;
  std::deque<Candidate> candidates_;
  std::vector<Known> known_;  ///< members as told last, and those that a coordinator that took over may lack
  Clock::time_point heard_{}, joined_{}, hello_deadline_{}, next_search_{}, start_searching_ = start_;
  bool foreign_ = false;  ///< whether something else answers at the rendezvous
  std::uint64_t committed_ = 0, seen_ = 0;

  // What both threads use.
  std::mutex mutex_;
  std::condition_variable changed_;
  std::optional<Json> question_, answer_;
  std::deque<Json> outbox_;
  std::map<std::string, std::vector<char>> store_;  ///< of the last meeting, by key
  std::uint64_t store_meeting_ = 0;
  std::optional<std::pair<std::string, std::string>> failure_;
  bool stop_ = false, leaving_ = false;
  std::thread thread_;
};

}  // namespace citylearn
