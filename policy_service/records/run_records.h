// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <set>
#include <string>

#include "policy_service/env_client/env_client.h"
#include "policy_service/interchange/event_log.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/records/best_checkpoint.h"
#include "policy_service/records/episode_log.h"
#include "policy_service/records/metrics_log.h"
#include "policy_service/records/output_folder.h"
#include "policy_service/records/policy_service_options.h"
#include "policy_service/records/run_announcer.h"

namespace citylearn {

/// Writes everything that a run leaves behind, into the output folder and for services that watch it. What a full disk
/// refuses is kept in memory and retried. Used by one thread.
class RunRecords {
 public:
  /// Parameters in effect, by "network", "learner" and "trainer".
  using Parameters = std::map<std::string, std::map<std::string, double>>;

  /// Prepares the output folder and records the episodes of `client`. All arguments must outlive it; `options` may
  /// change until announce(). Throws Error when the folder cannot be used or holds another run.
  RunRecords(const PolicyServiceOptions& options, Node& node, EnvClient& client);
  ~RunRecords() { client_.finished = nullptr; }
  RunRecords(const RunRecords&) = delete;
  RunRecords& operator=(const RunRecords&) = delete;

  /// Names this run; kept when it is resumed.
  std::uint64_t run_id() const { return run_id_; }
  std::string checkpoint_folder() const { return options_.output + "/checkpoints"; }

  /// Opens the logs of training, reads what an earlier stretch has as its best checkpoint and writes manifest.json.
  /// Rows past `updates` and points past `steps` are dropped: a killed process wrote them, and they will be computed
  /// again.
  void open_training_logs(std::uint64_t updates, std::uint64_t steps, const Parameters& parameters);
  /// Returns the seconds of training in the logs that were kept: in all, and up to an episode.
  double earlier_wall() const { return metrics_ ? metrics_->wall() : 0; }
  double earlier_wall_at(std::uint64_t episodes) const { return metrics_ ? metrics_->wall_at(episodes) : 0; }

  /// Announces the run; `learner` is empty where nothing is learned.
  void announce(const std::string& learner, std::uint64_t updates, const Parameters& parameters);
  bool announced() const { return announcer_ != nullptr; }

  void add(msg::TrainingStat& stat);
  void save_checkpoint(std::uint64_t update, Checkpoint checkpoint);
  /// Keeps the checkpoint as the best one if its agent's mean SPL in an evaluation is the highest.
  void save_evaluated(Checkpoint checkpoint, double spl);
  /// Returns the best checkpoint of this run; null without --output.
  const BestCheckpoint* best() const { return best_ ? &*best_ : nullptr; }
  /// Acknowledges episodes, sends figures again and retries failed writes. Call it whenever messages were handled.
  void handle();
  /// Acknowledges the episodes that were recorded: all, or not so often that waiting for the disk takes much time.
  void acknowledge(bool all = true);
  /// Returns whether a service that watches the run lacks figures and is alive as far as is known.
  bool reader_expected() const { return announcer_ && announcer_->reader_expected(); }
  /// Tries everything once more, and writes a training's manifest anew, with the traversals that came after its start.
  /// Throws Error when something cannot be written.
  void require_all_written();
  /// Announces that the run has ended.
  void end();

 private:
  void write_manifest();
  nlohmann::ordered_json manifest(const Parameters& parameters);
  void write_pending_checkpoints();
  void report_problems();

  const PolicyServiceOptions& options_;
  Node& node_;
  EnvClient& client_;
  const OutputFolder folder_;
  std::uint64_t run_id_ = 0;
  std::unique_ptr<RunAnnouncer> announcer_;
  std::unique_ptr<EpisodeLog> episodes_;
  std::unique_ptr<MetricsLog> metrics_;
  std::unique_ptr<EventLog> events_;
  Parameters parameters_;
  std::map<std::string, msg::TraversalInfo> traversals_;  ///< that were there at some time
  std::set<EnvHandle*, ById> to_acknowledge_;
  Clock::time_point next_acknowledgement_;
  // Checkpoints that the disk did not take.
  struct Pending {
    std::uint64_t update = 0;
    Checkpoint checkpoint;
  };
  std::optional<Pending> pending_;
  std::optional<Checkpoint> evaluated_;
  Clock::time_point retry_{};
  std::optional<BestCheckpoint> best_;
};

}  // namespace citylearn
