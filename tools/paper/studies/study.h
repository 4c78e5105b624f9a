// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "tools/lab/training.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// The trained agent of an earlier study that saved its parameters; its unit is added before those that use it.
struct SavedAgent {
  Json study;  ///< spec of its unit
  const Work* work = nullptr;
};

/// One policy and its trials.
struct Study {
  enum class Kind {
    kTraining,   ///< an agent is trained, then tried
    kUnchanged,  ///< the agent `initial` is tried as it is, given the features of this route's places
    kControl,    ///< a policy that learns nothing is tried
  };
  Kind kind = Kind::kTraining;
  std::string policy, learner = "ppo";
  std::string representation;
  int first = 0, frames = 128;           ///< the route; N steps are the limit of its tasks
  std::vector<std::string> experiences;  ///< traversals that it learns from, or that a filter knows, besides
                                         ///< World::train()
  std::uint64_t seed = 1;
  std::uint64_t steps = 0;                   ///< of training; 0: the agent's recommendation
  int deploy_every = 0;                      ///< episodes between trials during training; 0: none
  int tasks = 2000;                          ///< of the trials at the end
  int tasks_between = 200;                   ///< of those during training
  std::vector<std::string> traversals;       ///< that it is tried on
  double seconds = 30;                       ///< estimate
  bool save_parameters = false;              ///< the outcome contains the trained parameters, for others to begin with
  std::optional<SavedAgent> initial;         ///< the agent whose parameters it begins with; none: random ones
  std::vector<std::string> frozen;           ///< tensors, or beginnings of their names, that stay as they are
  Imperfections imperfections;               ///< of the world, in training and trials; those that befall agents
  std::map<std::string, double> parameters;  ///< of the network or control; what is not given is the recommendation
};

/// Returns the unit of work of a study. Outcome of a training: "curve": {"episodes", "steps", "seconds", "reward",
/// "spl", "length"}, a number an update: means over the episodes that ended in it (null where none did); "deployments":
/// [{"episodes", "traversal", SCORE}]; "trials": [{"traversal", "shuffled", SCORE}], those not shuffled with "walk"
/// (walk.h); "episodes", "steps", "seconds"; "spl95": {"episodes", "steps", "seconds"} or null; "parameters": text,
/// where they are saved. Of other kinds: [{"traversal", SCORE}]. SCORE: tasks, completed, spl, excess, steps, reward.
/// All but the seconds are the same again with the same seed.
Unit unit_of(const Study& study, World& world);

/// {"slip", "dropped_frames", "kidnappings"}.
Json as_json(const Imperfections& world);

/// Returns the agent of a study that saves its parameters.
SavedAgent saved_agent(const Study& study, World& world, const Work& work);

}  // namespace citylearn::paper
