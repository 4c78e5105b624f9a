// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "policy_service/distributed/parameter_fetch.h"
#include "policy_service/distributed/trajectory_outbox.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {

/// Returns what is wrong with a learner's announcement; empty when nothing is.
std::string validation_error(const msg::LearnerInfo& info);

/// Returns whether two announcements differ only in what changes while a learner learns: its lesson and parameters.
bool same_task(const msg::LearnerInfo& one, const msg::LearnerInfo& other);

/// An actor's work for one incarnation of a learner: it acts on env_services, a segment of steps at a time, and sends
/// each segment as trajectories. Used by one thread.
class LearnerSession {
 public:
  /// `node` and `workers` must outlive it.
  LearnerSession(Node& node, const msg::LearnerInfo& info, WorkerPool& workers);

  /// Returns what the learner's announcement requires of env_services.
  EnvRequirements requirements() const;
  /// Returns whether an env_service hosts the traversal that is learned from, and is usable under requirements().
  bool serves(const EnvHandle& env) const;
  /// Builds network and collector once the route's features are available. Returns whether they exist. Throws Error
  /// when the learner's network is not that of this program.
  bool prepare(EnvClient& client);
  bool prepared() const { return collector_ != nullptr; }
  /// Takes in a later announcement. Returns whether a new lesson began. Throws Error as prepare().
  bool update(const msg::LearnerInfo& info);

  const msg::LearnerInfo& info() const { return info_; }
  std::string learner() const { return info_.header().sender().c_str(); }
  ParameterFetch* parameters() { return parameters_.get(); }  ///< null until prepared
  /// Returns the newest complete parameters, null before the first.
  std::shared_ptr<const VersionedParameters> newest_parameters() const {
    return parameters_ ? parameters_->newest() : nullptr;
  }
  void request_missing_parameters() { parameters_->request_missing(node_); }

  /// Begins to act on an env_service, or begins anew, and returns the settings to command. `slot` names its random
  /// streams and is never used twice. Requires prepare(), as do all of these.
  msg::TaskSettings begin(EnvHandle& env, int slot);
  /// Ends to act on it. Returns false when it was not acted on.
  bool end(EnvHandle& env);
  /// Fills the agents' actions. Returns false when the segment has ended and too many are unacknowledged: resume() does
  /// it later.
  bool act(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  /// Fills the actions that act() did not, once there is room for another segment. Returns false when there is none, or
  /// act() filled them.
  bool resume(EnvHandle& env, std::vector<std::uint8_t>& choice);
  void believe(EnvHandle& env, msg::Belief& belief) const { collector_->believe(served_.at(&env).slot, belief); }
  /// Returns the env_services that are acted on.
  std::vector<EnvHandle*> envs() const;
  bool acts_on(EnvHandle& env) const { return served_.contains(&env); }
  bool blocked() const;  ///< Returns whether one of them waits for acknowledgements.
  LogSender::Acknowledged acknowledge(const msg::LogAcknowledgement& acknowledgement);

  TrajectoryOutbox outbox;

 private:
  using ParametersUsed = std::shared_ptr<const VersionedParameters>;
  struct Served {
    int slot = 0;
    ParametersUsed parameters;           ///< those of the whole segment
    std::uint64_t segment_step = 0;      ///< of the segment's first observation
    bool blocked = false;                ///< its segment is sent, the next one has not begun
    std::deque<std::uint64_t> segments;  ///< unacknowledged: the number of the last trajectory of each
  };

  void begin_lesson();
  void expect_parameters();
  void send_segment(const EnvHandle& env, Served& served);
  bool begin_next_segment(Served& served, std::vector<std::uint8_t>& choice);

  Node& node_;
  msg::LearnerInfo info_;
  WorkerPool& workers_;
  NetworkTask task_;
  std::unique_ptr<const AgentNetwork<float>> network_;
  std::unique_ptr<Collector> collector_;
  std::unique_ptr<ParameterFetch> parameters_;
  std::map<EnvHandle*, Served, ById> served_;
};

}  // namespace citylearn
