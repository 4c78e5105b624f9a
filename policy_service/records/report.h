// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "policy_service/records/best_checkpoint.h"
#include "policy_service/records/policy_service_options.h"
#include "policy_service/results/score.h"

namespace citylearn {

/// Figures of one training run.
struct TrainingReport {
  std::string traversal;
  std::uint64_t episodes = 0;
  std::uint64_t steps = 0;
  double wall = 0;                   ///< seconds
  double inference = 0, update = 0;  ///< seconds of this process's training; the rest is waiting for environments
  double reward = 0, spl = 0;        ///< means over the last 100 training episodes
  std::optional<std::uint64_t> episodes_to_spl95;  ///< when the mean SPL of the last 100 training episodes reached 0.95
  std::optional<double> wall_to_spl95;
  std::uint64_t updates = 0;  ///< of this process
  double policy_lag = 0;      ///< updates between acting and learning, mean over those; 0 in role both
  std::uint64_t dropped = 0;  ///< trajectories that were too old
  double waited = 0;          ///< seconds in which actors waited for the learner, in all
  std::optional<BestCheckpoint::Figures> best;
};

/// Returns the text of summary.json. Rows of the agent go under "evaluate", all others under "controls".
std::string summary_json(const PolicyServiceOptions& options, const TrainingReport* training,
                         const std::vector<ScoreRow>& rows);

/// Returns what manifest.json says: everything needed to repeat the run. `agent` holds the effective parameters of
/// network, learner and trainer; `traversals` what the env_services announced, by name; `job` the run_id of RunInfo.
/// "origins" says where each option comes from that does not have its default, "command" how the program was started
/// and "options" the value of each as text, both where it has a command line.
nlohmann::ordered_json manifest_json(const PolicyServiceOptions& options,
                                     const std::map<std::string, std::map<std::string, double>>& agent,
                                     const std::map<std::string, msg::TraversalInfo>& traversals,
                                     const std::string& middleware, std::uint64_t job);

}  // namespace citylearn
