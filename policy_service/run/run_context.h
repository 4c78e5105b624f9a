// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/network/network_inputs.h"
#include "policy_service/records/run_records.h"
#include "policy_service/run/policy_service.h"
#include "policy_service/run/progress_bar.h"

namespace citylearn {

/// Thrown to leave a run when a signal asks it to stop.
struct StopRequested {};

/// Thrown when env_services have not come within --wait.
struct EnvServicesMissing : Error {
  using Error::Error;
};

/// The state that the parts of a run share: its options, its env_services and its records. Used by one thread.
class RunContext {
 public:
  /// `node` and `client` must outlive it.
  RunContext(const PolicyServiceOptions& options, Node& node, EnvClient& client);
  ~RunContext() {
    client.decide = nullptr, client.believe = nullptr, client.joined = nullptr, client.fetching = nullptr;
  }

  PolicyServiceOptions options;  ///< describe the agent itself, once a checkpoint is loaded
  Node& node;
  EnvClient& client;
  RunRecords records;
  ProgressBar progress;
  std::function<void()> on_spin;  ///< called for each spin(), after the messages of env_services

  /// Handles messages for `moment` at most, and everything that is due. All waiting of a run happens here. Throws
  /// StopRequested.
  void spin(std::chrono::milliseconds moment = kStopCheckInterval);
  /// Refuses env_services that do not fit the route of the options, the agent's features and what is learned from, as
  /// far as these are known.
  void require(std::optional<int> feature_dimension = {}, const TrainingData& learned = {});
  /// Takes from these env_services whether the run is on streets, and what its default limits are there. Lowers a
  /// default number of frames to what all of them have, on streets takes all of the first one's, and the step limit
  /// that follows from it, and refuses env_services that do not fit. Does so once.
  void fit_route(const std::vector<EnvHandle*>& envs);
  /// Returns the states of a traversal's streets; null on a line, and without an env_service.
  std::shared_ptr<const StateMap> streets_on(const std::string& traversal) const;
  /// Waits until every traversal has an env_service, and each training traversal `training_envs` of them. Throws
  /// EnvServicesMissing after --wait.
  void wait_for_envs(const std::set<std::string>& traversals, int training_envs);
  /// Waits until each training traversal has `count` env_services. Throws EnvServicesMissing after --wait.
  void wait_for_training_envs(int count);
  /// Returns the env_services of a traversal that are usable and do not work for another policy_service.
  std::vector<EnvHandle*> envs_on(const std::string& traversal) const;
  /// Returns those of all training traversals, in their order.
  std::vector<EnvHandle*> training_envs() const;
  /// Returns which of the training traversals this one is; -1: none of them.
  int experience_on(const std::string& traversal) const;
  /// Returns one of the env_services of a traversal, or null.
  EnvHandle* env_on(const std::string& traversal) const;
  /// Waits for the env_services to evaluate on and returns one for each traversal. With `remembers`, which is what an
  /// agent does that goes by the features of --train, it waits for these traversals too.
  std::vector<EnvHandle*> evaluation_envs(bool remembers);
  /// Returns the features of a traversal's route, D numbers a place, fetched once; empty when it has none or no
  /// env_service. An env_service that does not deliver them is refused.
  const std::vector<float>& features_on(const std::string& traversal);
  /// Returns the features of the training traversals' route side by side, as NetworkTask has them; empty when one has
  /// none or no env_service. Throws Error when theirs are of different kinds.
  const Matrix<float>& reference();
  /// Leaves the env_services idle for the next policy_service, and lets them forget the episodes of this one.
  void leave();

 private:
  void handle();
  void require_checkpoints_data(const std::string& traversal) const;
  bool free(const EnvHandle& env) const;

  std::map<std::string, std::vector<float>> features_;  ///< by traversal
  Matrix<float> reference_;                             ///< what reference() returns, once it is there
  std::optional<int> feature_dimension_;                ///< that is required
  TrainingData learned_;                                ///< likewise
  std::optional<bool> streets_;                         ///< whether the run is on them; unset: not known yet
  bool all_frames_ = false;                             ///< on streets, each traversal's route is all of its frames
};

}  // namespace citylearn
