// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "core/wire/service.h"
#include "policy_service/env_client/env_client.h"
#include "policy_service/learning/trainer.h"

namespace citylearn {

/// TrainerOptions::max_detour until the route is known: 3 on streets, else 0.
inline constexpr int kDefaultDetour = -1;

/// Options of a run. With mode "evaluate" `agent` may be a control.
struct PolicyServiceOptions : TrainerOptions {
  Node::Options node;

  // What to do.
  std::string mode = "train";      ///< "train" (then evaluate), or "evaluate"
  std::string checkpoint;          ///< mode "evaluate": the file to act from
  std::string parameters;          ///< with `checkpoint`: safetensors file whose parameters go before its own
  std::string role = "both";       ///< "both", "actor" or "learner" (docs/decisions/0008-roles.md)
  bool resume = false;             ///< continue from the newest checkpoint of `output`; start anew where there is none
  bool overwrite = false;          ///< replace an earlier run in `output`
  std::string initial_checkpoint;  ///< its agent becomes `initial`; empty: random parameters

  // Where.
  /// Traversals learned from: experiences of one route, which the first one's frames define.
  std::vector<std::string> train = {"summer"};
  std::vector<std::string> evaluate;  ///< traversals evaluated on; empty: all that are found
  /// Options by which env_services and encoder_services made what is learned from, by name, for TrainingData::source.
  std::map<std::string, std::string> source;
  int environments = 1;   ///< env_services on each of `train` to begin with
  bool lockstep = false;  ///< wait for lost ones instead of continuing without them
  EnvClientOptions client;
  double wait = 0;  ///< seconds until missing env_services are an error; 0 = for ever

  // Roles.
  int window = 2;             ///< learner: segments of one env_service that an actor may have unacknowledged
  std::uint64_t max_lag = 0;  ///< learner: trajectories of parameters older than so many updates are dropped; 0 = none
  bool stay = false;          ///< actor: wait for the next learner when one has ended

  // Ranks: learners that share the work (docs/decisions/0021-ranks.md); TrainerOptions::rank is this one's.
  std::optional<std::uint32_t> ranks_domain;  ///< DDS domain in which they meet; none: there are no others
  int ranks = 0;                              ///< how many there are; 0: as the launcher's environment says
  std::string sync = "update";    ///< "update": parameters are averaged once an update; "step": gradients at each step
  std::vector<int> ranks_before;  ///< how many there were in earlier stretches of a run that is resumed
  double ranks_wait = 60;         ///< seconds until missing ranks are an error
  bool unprotected_sums = false;  ///< adds over connections without keys though the services have some

  // The task.
  int frames = 128;         ///< N
  bool cap_frames = false;  ///< fewer where the traversals have fewer, as for a default; on streets all
  bool cap_steps = false;   ///< `max_steps` is N, as for a default
  float goal_radius = 0;    ///< metres; on streets a goal is also reached at places within it

  // How long.
  std::uint64_t steps = 0;    ///< environment steps to learn from; 0 = the agent's recommendation
  double time_limit = 0;      ///< seconds of training; 0 = none
  double stop_when = 0;       ///< training ends at this mean SPL over the last 100 training episodes; 0 = never
  int checkpoint_every = 50;  ///< updates
  int evaluate_every = 0;     ///< updates; 0 = at the end only

  // Evaluation.
  int tasks = 2000;                   ///< on each traversal
  std::vector<std::string> controls;  ///< evaluated on the same tasks; "shuffled" is the agent on shuffled frames
  std::map<std::string, std::map<std::string, double>> control_parameters;

  /// Folder for summary.json, metrics.csv, episodes.csv, manifest.json, checkpoints/, tensorboard/.
  std::string output;

  /// The options of the command line, from option_values(). checked_options() turns them into
  /// effective_configuration(), for manifest.json.
  std::vector<OptionValue> configuration;
  std::vector<std::string> command;  ///< the words of the whole command line, for manifest.json
};

}  // namespace citylearn
