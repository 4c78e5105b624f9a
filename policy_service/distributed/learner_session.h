// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "policy_service/distributed/parameter_fetch.h"
#include "policy_service/distributed/trajectory_outbox.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {

/// Returns what is wrong with a learner's announcement; empty when nothing is.
std::string validation_error(const msg::LearnerInfo& info);

/// Returns whether two announcements differ only in what changes while a learner learns: its lesson and parameters.
bool same_task(const msg::LearnerInfo& one, const msg::LearnerInfo& other);

/// An actor's work for one incarnation of a learner. Used by one thread.
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
  Collector& collector() { return *collector_; }
  ParameterFetch* parameters() { return parameters_.get(); }  ///< null until prepared
  /// Returns the newest complete parameters, null before the first.
  std::shared_ptr<const VersionedParameters> newest_parameters() const {
    return parameters_ ? parameters_->newest() : nullptr;
  }
  void request_missing_parameters() { parameters_->request_missing(node_); }

  TrajectoryOutbox outbox;

 private:
  void begin_lesson();
  void expect_parameters();

  Node& node_;
  msg::LearnerInfo info_;
  WorkerPool& workers_;
  NetworkTask task_;
  std::unique_ptr<const AgentNetwork<float>> network_;
  std::unique_ptr<Collector> collector_;
  std::unique_ptr<ParameterFetch> parameters_;
};

}  // namespace citylearn
