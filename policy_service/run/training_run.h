// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "policy_service/distributed/heartbeat_thread.h"
#include "policy_service/distributed/learner_server.h"
#include "policy_service/learning/trainer.h"
#include "policy_service/ranks/shared_updates.h"
#include "policy_service/records/report.h"
#include "policy_service/run/collapse_watch.h"
#include "policy_service/run/evaluation_run.h"
#include "policy_service/run/run_context.h"

namespace citylearn {

/// Trains one agent from the start, or from the newest checkpoint, to the end. Subclasses provide the samples.
class TrainingRun {
 public:
  /// `context` and `evaluation` must outlive it.
  TrainingRun(RunContext& context, EvaluationRun& evaluation) : context_(context), evaluation_(evaluation) {}
  virtual ~TrainingRun() = default;

  /// Trains, saves the last checkpoint, also at a signal, and hands the agent to the evaluation. Throws Error or
  /// StopRequested.
  void execute();
  /// Returns the update of the newest checkpoint; none before the first one.
  std::optional<std::uint64_t> saved() const { return saved_; }
  const TrainingReport& report() const { return report_; }
  const Trainer* trainer() const { return trainer_.get(); }  ///< null until env_services have come

 protected:
  virtual void train() = 0;  ///< calls update() until it returns false
  /// Evaluates between two updates. Returns as EvaluationRun::evaluate_others().
  virtual std::optional<double> evaluate_others() { return evaluation_.evaluate_others(); }
  virtual double policy_lag() const { return 0; }         ///< mean age of what acted for the last update, in updates
  virtual std::string actors_note() const { return ""; }  ///< what the progress bar says of the actors

  /// Makes one update by `learn`, records it, and saves and evaluates when due. Returns false when training is over.
  bool update(const std::function<UpdateFigures()>& learn);
  /// Returns whether the training has taken all its steps or reached --stop-when.
  bool ended() const;
  double wall() const { return earlier_wall_ + seconds_since(since_); }

  RunContext& context_;
  EvaluationRun& evaluation_;
  std::unique_ptr<Trainer> trainer_;
  TrainingData learned_;
  TrainingReport report_;

 private:
  void build_trainer();
  void join_ranks();
  void record_update(const UpdateFigures& figures, std::uint64_t steps_before);
  void warn_of_collapse();
  /// Returns the fraction of --time-limit that has passed.
  double elapsed_fraction() const { return context_.options.time_limit > 0 ? wall() / context_.options.time_limit : 0; }
  bool time_is_up() const { return (sharing_ ? trainer_->elapsed() : elapsed_fraction()) >= 1; }
  Checkpoint with_data(Checkpoint checkpoint) const;
  /// Saves a checkpoint; of several ranks only the lowest one does.
  void save(Checkpoint checkpoint);
  void save_newest();

  Clock::time_point since_, last_update_;
  double earlier_wall_ = 0;           ///< seconds of training before this process
  std::unique_ptr<RankGroup> ranks_;  ///< null without other ranks
  std::unique_ptr<SharedUpdates> sharing_;
  std::optional<std::uint64_t> saved_;
  CollapseWatch watch_;
  bool collapsed_ = false;
};

/// Acts and learns in this process (role both).
class LocalTrainingRun : public TrainingRun {
 public:
  LocalTrainingRun(RunContext& context, EvaluationRun& evaluation)
      : TrainingRun(context, evaluation), heartbeat_(context.node) {}

 private:
  void train() override;
  void enroll(EnvHandle& env);
  void drop(EnvHandle& env);
  /// Goes on without env_services that are refused or silent. Waits while none is left; throws Error after --wait.
  void drop_lost_envs();
  void train_on();

  HeartbeatThread heartbeat_;
  std::map<const EnvHandle*, int, ById> slots_;  ///< numbers of training environments, for their random streams
  std::set<EnvHandle*, ById> active_;            ///< training environments that are not lost
};

/// Learns from what actors send (role learner).
class LearnerRun : public TrainingRun {
 public:
  using TrainingRun::TrainingRun;
  ~LearnerRun() override { context_.on_spin = nullptr; }

 private:
  void train() override;
  /// Tells the actors that training is over and takes the env_services over. Not so when it was stopped: actors then
  /// wait for a learner that resumes.
  void dismiss_actors();
  std::optional<double> evaluate_others() override;
  double policy_lag() const override { return server_->policy_lag(); }
  std::string actors_note() const override;
  void warn_of_lag();

  std::unique_ptr<LearnerServer> server_;
  bool warned_of_lag_ = false;
};

}  // namespace citylearn
