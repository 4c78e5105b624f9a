// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <optional>
#include <set>
#include <vector>

#include "core/exchange/presence.h"
#include "core/exchange/timing.h"
#include "core/wire/node.h"
#include "core/wire/rejections.h"
#include "dashboard/store/store.h"

namespace citylearn {

/// Records in the store what services send: episodes (idl/episode.idl), training figures, runs and traversals. It makes
/// itself known to each env_service and policy_service, commits their records in batches, and acknowledges them after
/// the commit. While the store cannot be written (disk full), it acknowledges nothing, reports that, and tries again;
/// the services keep their records. Belongs to the thread of its node.
class Recorder {
 public:
  /// `node` and `store` must outlive it. After a failure of the store it tries again after `retry_after`.
  Recorder(Node& node, Store& store, std::chrono::milliseconds retry_after = kCommitRetry);

  /// Called for each event that the recorder adds to the store, alarms among them.
  std::function<void(const Event&)> on_event;

  // The caller takes these from the node, which has readers for them, and passes them on. The recorder takes
  // EpisodeStats itself.
  void on_message(const msg::ServiceStatus& status);
  void on_message(const msg::TraversalInfo& info);
  void on_message(const msg::RunInfo& info);
  void on_message(const msg::TrainingStat& stat);

  /// Does what is due. Call it when a message may have arrived, and at due().
  void poll();
  Clock::time_point due() const { return due_; }

  /// Commits and acknowledges what has arrived. With `leave` it unregisters, so that env_services stop buffering
  /// episodes for this dashboard; otherwise they buffer until it is back.
  void finish(bool leave);

  std::uint64_t recorded() const { return recorded_; }  ///< episodes, by this process
  bool failing() const { return failing_; }             ///< the store cannot be written

 private:
  /// The figures of one policy_service process about one run.
  struct Run {
    RecordedNumbers figures;  ///< by their numbers in the log; given up: those that the process does not have
    Presence process;
    std::optional<msg::RunInfo> contender;  ///< newest one of another process, accepted once this one is silent
    bool reported = false;                  ///< that another process continues this run too
  };
  using RunKey = std::pair<Sender, std::uint64_t>;  // policy_service and run_id
  void take();
  void commit();
  void commit_stats();
  bool held_by_other_process(const msg::RunInfo& info);
  void acknowledge(const Sender& environment, msg::ReaderState state = msg::READS);
  void acknowledge(const RunKey& run, msg::ReaderState state = msg::READS);
  void report(Event event);
  bool attempt(const std::function<void()>& work);
  void wake_at(Clock::time_point time) { due_ = std::min(due_, time); }

  Node& node_;
  Rejections rejections_{node_};
  Store& store_;
  const std::chrono::milliseconds retry_after_;
  std::vector<msg::EpisodeStat> episodes_;      // not committed yet
  std::vector<msg::TrainingStat> stats_;        // likewise
  std::vector<Event> events_;                   // likewise
  std::map<Sender, msg::TraversalInfo> infos_;  // likewise
  std::set<Sender> endings_;                    // likewise
  Clock::time_point first_waits_;               // the first of them came
  std::set<Sender> environments_;               // that run
  std::map<RunKey, Run> runs_;
  Clock::time_point due_, next_try_;
  bool failing_ = false;
  std::uint64_t recorded_ = 0;
  msg::EpisodeStat taken_;
};

}  // namespace citylearn
