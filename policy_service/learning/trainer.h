// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/collector.h"
#include "policy_service/learning/learner.h"

namespace citylearn {

struct TrainerOptions {
  // Plug-ins, and the parameters given for them; what is not given is the network's recommendation, else the default.
  std::string agent = "place_filter";
  std::string learner = "ppo";
  std::map<std::string, double> network_parameters, learner_parameters, trainer_parameters;
  std::uint64_t seed = 1;

  // The task.
  int first_frame = 0;      ///< of the route, index on the traversal
  int max_steps = 0;        ///< 0 = N
  bool curriculum = false;  ///< the paper's lessons, as far as N goes

  // What it begins with.
  std::optional<TrainedAgent> initial;  ///< its parameters, learned on whatever route; none: random ones
  std::vector<std::string> frozen;      ///< tensors of the network, or beginnings of their names, that stay as they are
};

/// How far training has come. Changes only in Trainer::update and learn.
struct TrainingProgress {
  std::uint64_t updates = 0, steps = 0, episodes = 0;
  int lesson = 0;                                  ///< of the curriculum, from 0
  double smoothed_reward = 0;                      ///< of finished episodes, as the curriculum sees it
  double reward, spl;                              ///< means over the last 100 episodes; NaN before the first
  std::optional<std::uint64_t> episodes_to_spl95;  ///< when the mean SPL of the last 100 episodes first reached 0.95
  std::optional<std::uint64_t> steps_to_spl95;
};

/// Trains one agent on any number of environments, each with agents of its own. No wire and no clock: the same
/// observations give the same bits, in whatever order the environments' observations come. Used by one thread.
///
/// Collects `segment` ticks of every environment, then waits for update(). An environment whose segment is full gets
/// its next actions from resume(), after the update.
class Trainer {
 public:
  /// Throws Error: unknown plug-ins or parameters, a `task` that they cannot work with, an initial agent whose tensors
  /// are others, frozen tensors that are not there or that the learner cannot freeze.
  Trainer(const TrainerOptions& options, const NetworkTask& task);
  ~Trainer();
  /// Parameters of collecting: segment, sequence, steps, agents, noise-frame, noise-place, noise-episode.
  static std::vector<ParameterSpec> parameter_specs();

  /// An environment takes part from its first observation on. `environment` names its random streams. Called again, it
  /// begins anew: what it had of the segment is dropped.
  void add(int environment, int agents);
  void remove(int environment);
  /// What the environment shall do, under the present cut: all fields but header, environment, settings id and job.
  void settings(int environment, msg::TaskSettings& settings) const;

  /// Takes in the next observation; the first one must be of step 0. True: `choice` has the actions. False: the segment
  /// is full; resume() will tell them. Throws Error when the observation does not fit.
  bool act(int environment, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  bool full(int environment) const;
  /// All environments are full; false when there is none.
  bool ready() const;
  /// Learns from all environments; requires ready(). When the cut() has changed afterwards (a new lesson), environments
  /// need new settings and resume() must not be called.
  UpdateFigures update();
  /// Learns from what others collected, at whatever lag: for a learner without environments of its own. `finished`: the
  /// episodes that ended meanwhile, in the order of their ends. A new cut means a new lesson.
  UpdateFigures learn(std::span<Rollout* const> rollouts, std::span<const FinishedEpisode> finished);
  /// Sequences that such an update should have: as many as those of the parameter `agents` in a segment.
  int batch() const;
  /// As Learner::come_to(), before update() or learn(): by a clock that this class does not have.
  void come_to(double share);
  /// All that whoever collects for this trainer must know: fields of the task, the network and the disguise.
  void describe(msg::LearnerInfo& info) const;

  /// After update(): the actions for the observation that found the segment full.
  void resume(int environment, std::vector<std::uint8_t>& choice);

  /// Number of the cut: at each one all environments begin anew with settings(), every agent a new episode.
  std::uint64_t cut() const;
  /// Begins a new cut and returns everything needed to go on after it, in another process too; what is collected of the
  /// present segment is dropped. Environments need new settings afterwards. `manifest` (JSON, may be empty) goes along.
  Checkpoint checkpoint(const std::string& manifest = "");
  /// Goes on from a checkpoint of a trainer with the same options and task. Throws Error naming what differs.
  void load(const Checkpoint& checkpoint);

  const TrainingProgress& progress() const;
  std::uint64_t total_steps() const;                ///< the parameter `steps`
  bool done() const;                                ///< learned from that many
  TrainedAgent agent() const;                       ///< with a copy of the present parameters
  const Vector<float>& network_parameters() const;  ///< the present ones; valid until the next update
  const std::vector<std::string>& frozen() const;   ///< names of the tensors that stay as they are
  /// Effective parameters by "network", "learner" and "trainer", for manifests.
  std::map<std::string, std::map<std::string, double>> parameters() const;
  /// Those of `agent` and `learner` without options given: `recommended_parameters("features",
  /// "ppo")["trainer"]["agents"]`.
  static std::map<std::string, std::map<std::string, double>> recommended_parameters(const std::string& agent,
                                                                                     const std::string& learner);

 private:
  struct Parts;
  std::unique_ptr<Parts> parts_;
};

}  // namespace citylearn
