// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Puts what services send into the store: the dashboard as a recorder of episodes (idl/episode.idl). It makes itself
/// known to each env_service it hears of, commits what they send in batches, and acknowledges after the commit. It asks
/// policy_services for TrainingStats that did not come. While the store cannot be written (disk full), it acknowledges
/// nothing, says so and tries again; the env_services keep their episodes. Belongs to the thread of its node.
class Recorder {
 public:
  struct Options {
    std::size_t most_at_once = 2000;                 ///< episodes of a transaction
    std::chrono::milliseconds gather{50};            ///< longest that an episode waits for others
    std::chrono::milliseconds ask_after{300};        ///< TrainingStats may come late by themselves
    std::chrono::milliseconds again_after{1000};     ///< without an answer; also when the store failed
    std::chrono::milliseconds policy_silence{3000};  ///< without RunInfo there is nobody to be asked
  };
  /// `node` and `store` must outlive it.
  Recorder(Node& node, Store& store, const Options& options);
  Recorder(Node& node, Store& store) : Recorder(node, store, Options()) {}

  /// Called for each event that the recorder adds to the store's, alarms among them.
  std::function<void(const Event&)> told;

  // Whoever takes these from the node hands them on. EpisodeStats the recorder takes itself.
  void hear(const msg::ServiceStatus& status);
  void hear(const msg::TraversalInfo& info);
  void hear(const msg::RunInfo& info);
  void hear(const msg::TrainingStat& stat);

  /// Does what there is to do: to be called whenever something may have come, and at due().
  void turn();
  Clock::time_point due() const { return due_; }

  /// Commits and acknowledges what has come. With `leave` it tells the env_services that they need keep nothing for
  /// this dashboard any more; without, they keep what it will miss until it is there again.
  void finish(bool leave);

  std::uint64_t recorded() const { return recorded_; }  ///< episodes, by this process
  bool failing() const { return failing_; }             ///< the store cannot be written

 private:
  /// What is asked of a policy_service's process about its job.
  struct Asked {
    NumberSet have;           ///< updates, recorded or not to be had
    std::uint64_t told = 0;   ///< updates it has made
    Clock::time_point heard;  ///< of its last RunInfo
    Clock::time_point complete;
    Clock::time_point next;
    std::uint64_t first = 0, last = 0;  ///< asked for; 0: nothing
    std::uint64_t answers = 0;          ///< to that
    int tries = 0;                      ///< without an answer
  };
  void take();
  void commit();
  void ask();
  void acknowledge(const Sender& environment, bool leaving);
  void tell(Event event);
  bool attempt(const std::function<void()>& work);
  void wake_at(Clock::time_point time) { due_ = std::min(due_, time); }

  Node& node_;
  Store& store_;
  const Options options_;
  std::vector<msg::EpisodeStat> episodes_;      // not committed yet
  std::vector<msg::TrainingStat> stats_;        // likewise
  std::vector<Event> events_;                   // likewise
  std::map<Sender, msg::TraversalInfo> infos_;  // likewise
  std::set<Sender> endings_;                    // likewise
  Clock::time_point first_waits_;               // the first of them came
  std::set<Sender> environments_;               // heard of
  std::set<Sender> senders_;                    // env_services that sent episodes: they know of this recorder
  std::map<std::pair<Sender, std::uint64_t>, Asked> jobs_;  // of policy_services
  Clock::time_point due_, next_try_;
  bool failing_ = false;
  std::uint64_t recorded_ = 0;
  msg::EpisodeStat taken_;
};

}  // namespace citylearn
