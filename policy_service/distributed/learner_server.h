// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>

#include "core/exchange/incumbent.h"
#include "core/wire/node.h"
#include "core/wire/rejections.h"
#include "policy_service/distributed/assignments.h"
#include "policy_service/distributed/heartbeat_thread.h"
#include "policy_service/distributed/parameter_fetch.h"
#include "policy_service/distributed/trajectories.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/learning/trainer.h"

namespace citylearn {

struct LearnerServerOptions {
  TraversalContents learned;  ///< contents of the env_services that actors may serve
  int window = 2;             ///< segments of one env_service that may be unacknowledged
  std::uint64_t max_lag = 0;  ///< updates; older trajectories are dropped; 0 = none is too old
  std::uint64_t run_id = 0;   ///< that the actors' work is part of
};

/// Serves the actors of a learner: tells them what to do, takes in their trajectories and sends them parameters
/// (docs/decisions/0008-roles.md). Used by one thread.
class LearnerServer {
 public:
  /// Throws Error when the trainer's trajectories do not fit into messages.
  LearnerServer(Node& node, const EnvClient& client, Trainer& trainer, const LearnerServerOptions& options);

  /// Handles all messages that have arrived and sends what is due. Call it whenever Node::wait() returns.
  void handle();
  /// Returns whether there are enough trajectories for an update.
  bool ready();
  /// Learns from the oldest trajectories and sends the actors the new parameters. Requires ready().
  UpdateFigures learn();
  /// Tells the actors that training is over, so that they release their env_services.
  void end();

  int actors() const;     ///< number of actors heard lately that do not work for another learner
  bool released() const;  ///< whether none of them serves an env_service any more
  double policy_lag() const { return policy_lag_; }           ///< of the last update, mean over its trajectories
  std::uint64_t dropped() const { return queue_.dropped(); }  ///< trajectories that were too old
  double waited() const;  ///< seconds in which actors waited for room here, all together

 private:
  struct Actor {
    Incumbent presence;
    bool present = false, available = false;
    std::set<std::uint64_t> serves;        ///< incarnations of env_services
    std::string elsewhere;                 ///< the other learner that it works for
    double waited = 0, waited_before = 0;  ///< by this incarnation, and by earlier ones
  };
  struct Version {
    std::shared_ptr<const ObjectBytes> object;
    Clock::time_point asked;
  };

  void on_status(const msg::ActorStatus& status);
  void on_trajectory(msg::Trajectory& trajectory);
  void on_request(const msg::ParametersRequest& request);
  void acknowledge(const std::string& actor);
  void send_info();
  void send_parameters();
  void count_actors();
  void assign();
  std::uint64_t version() const { return trainer_.progress().updates; }

  Node& node_;
  const EnvClient& client_;
  HeartbeatThread heartbeat_;
  Trainer& trainer_;
  LearnerServerOptions options_;
  TrajectoryQueue queue_;
  Rollout rollout_;
  double policy_lag_ = 0;
  msg::LearnerInfo info_;
  Assignments assignments_;
  Clock::time_point next_info_{}, next_assignments_;
  std::map<std::string, Actor> actors_;
  Rejections rejections_;
  std::set<std::string> to_acknowledge_;
  std::map<std::uint64_t, Version> versions_;  ///< parameters: the newest, and those being asked for
  ObjectServer server_;                        ///< of them
  msg::ActorStatus status_;
  msg::Trajectory trajectory_;
  msg::TrajectoryAcknowledgement acknowledgement_;
  msg::ParametersRequest request_;
  msg::ParametersChunk parameters_;
  msg::Assignment assignment_;
};

}  // namespace citylearn
