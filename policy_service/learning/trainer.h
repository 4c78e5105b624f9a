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
#include "policy_service/learning/learner.h"
#include "policy_service/learning/training_progress.h"
#include "policy_service/learning/update_sharing.h"
#include "policy_service/network/checkpoint/trained_agent.h"
#include "policy_service/rollout/collector.h"

namespace citylearn {

struct TrainerOptions {
  // Plug-ins, and the parameters given for them; what is not given is the network's recommendation, else the default.
  std::string agent = "place_filter";
  std::string learner = "ppo";
  std::map<std::string, double> network_parameters, learner_parameters, trainer_parameters;
  std::uint64_t seed = 1;
  int threads = 0;  ///< that act and learn, the caller's included; 0: as many as processors. Changes no result
  int rank = 0;     ///< of several trainers with this seed: the same initial parameters, random streams of its own

  // The task.
  int first_frame = 0;      ///< where the route begins, index on the traversal
  int max_steps = 0;        ///< 0 = N
  int max_detour = 0;       ///< limits an episode to this multiple of its fewest steps too; 0: does not
  bool curriculum = false;  ///< the paper's lessons, as far as N goes

  // What it begins with.
  std::optional<TrainedAgent> initial;  ///< gives its parameters, learned on any route; none: random ones
  std::vector<std::string> frozen;      ///< tensors of the network, or prefixes of their names, that are not trained
};

/// Trains one agent on any number of environments, each with agents of its own. It uses neither wire nor clock: the
/// same observations give the same bits, in whatever order the environments' observations arrive. Used by one thread.
///
/// It collects `segment` ticks of every environment, then waits for update(). One whose segment is full gets its next
/// actions from resume(), after the update.
class Trainer {
 public:
  /// Throws Error naming an unknown plug-in or parameter, a `task` that they cannot work with, an initial agent with
  /// other tensors, or frozen tensors that do not exist or that the learner cannot freeze.
  Trainer(const TrainerOptions& options, const NetworkTask& task);
  ~Trainer();
  /// Returns the parameters of collecting: segment, sequence, steps, agents, noise-frame, noise-place, noise-episode.
  static std::vector<ParameterSpec> parameter_specs();

  /// Adds an environment, as Collector::add() does.
  void add(int environment, int agents, int experience = 0);
  void remove(int environment);
  /// Fills in the task of the environment: all but header, environment, settings id and run.
  void settings(int environment, msg::TaskSettings& settings) const;

  /// Takes in the next observation; the first one must be of step 0. Returns true with the actions in `choice`, or
  /// false when the segment is full and resume() will choose them. Throws Error when the observation does not fit.
  bool act(int environment, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  bool full(int environment) const;
  /// Returns whether all environments are full; false when there is none.
  bool ready() const;
  /// Learns from all environments; requires ready(). When the generation() has changed afterwards, environments need
  /// new settings and resume() must not be called.
  UpdateFigures update();
  /// Learns from rollouts that actors collected, at whatever lag. `finished` are the episodes that ended meanwhile, in
  /// the order of their ends. A new generation means a new lesson.
  UpdateFigures learn(std::span<Rollout* const> rollouts, std::span<const FinishedEpisode> finished);
  /// Gives a rollout the step limit and the rewards that are learned from, as learn() does; once or more often.
  void prepare(Rollout& rollout) const;
  /// Returns how many sequences such an update should have: those of `agents` agents in a segment.
  int batch() const;
  /// Does what Learner::set_progress() says; call it before update() or learn().
  void set_progress(double fraction);
  double elapsed() const;  ///< that fraction, the largest of all that share updates
  /// Makes every update together with other trainers from now on, beginning where they are; `sharing` must outlive
  /// this. Call it before an environment is added. Throws as UpdateSharing::share().
  void share_updates(UpdateSharing& sharing);
  /// Fills in what an actor must know: fields of the task, the network and the noise.
  void describe(msg::LearnerInfo& info) const;
  /// Chooses, after update(), the actions for the observation that found the segment full.
  void resume(int environment, std::vector<std::uint8_t>& choice);
  void believe(int environment, msg::Belief& belief) const;  ///< Does what Collector::believe() does.

  /// Returns the number of times that all environments began anew with settings(), every agent with a new episode.
  std::uint64_t generation() const;
  /// Begins a new generation and returns everything needed to continue after it, in another process too; the present
  /// segment is dropped. Environments need new settings afterwards.
  Checkpoint checkpoint();
  /// Returns a checkpoint that the present generation goes on without: what continues from it begins a new one.
  Checkpoint snapshot() const;
  /// Continues from a checkpoint of a trainer with the same options and task. Throws Error naming what differs.
  void load(const Checkpoint& checkpoint);

  const TrainingProgress& progress() const;
  std::uint64_t total_steps() const;                ///< the parameter `steps`
  bool done() const;                                ///< whether that many were learned from
  bool settled() const;                             ///< whether reward and SPL are of the last lesson's episodes alone
  TrainedAgent agent() const;                       ///< has a copy of the present parameters
  const Vector<float>& network_parameters() const;  ///< the present ones; valid until the next update
  const std::vector<std::string>& frozen() const;   ///< names of the tensors that are not trained
  std::string identity() const;  ///< JSON: what must be the same in trainers that continue or share updates
  /// Returns the parameters in effect by "network", "learner" and "trainer", for manifests.
  std::map<std::string, std::map<std::string, double>> parameters() const;
  /// Returns those of `agent` and `learner` when none are given: `recommended_parameters("features",
  /// "ppo")["trainer"]["agents"]`.
  static std::map<std::string, std::map<std::string, double>> recommended_parameters(const std::string& agent,
                                                                                     const std::string& learner);

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace citylearn
