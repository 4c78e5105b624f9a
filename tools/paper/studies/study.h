// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tools/lab/training.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// One policy and its trials.
struct Study {
  bool control = false;  ///< a policy that learns nothing is tried; else an agent is trained, then tried
  std::string policy, learner = "ppo";
  std::string representation;
  int frames = 128;  ///< the first ones are the route; as many steps are the limit of its tasks
  std::uint64_t seed = 1;
  std::uint64_t steps = 0;                   ///< of training; 0: the agent's recommendation
  int deploy_every = 0;                      ///< episodes between trials during training; 0: none
  int tasks = 2000;                          ///< of the trials at the end
  int tasks_between = 200;                   ///< of those during training
  std::vector<std::string> traversals;       ///< that it is tried on
  double seconds = 30;                       ///< estimate
  Imperfections imperfections;               ///< of the world, in training and trials; those that befall agents
  std::map<std::string, double> parameters;  ///< of the network or control; what is not given is the recommendation
};

/// Returns the unit of work of a study. Outcome of a training: "curve": {"episodes", "steps", "seconds", "reward",
/// "spl", "length"}, a number an update: means over the episodes that ended in it (null where none did); "deployments":
/// [{"episodes", "traversal", SCORE}]; "trials": [{"traversal", "shuffled", SCORE}];
/// "episodes", "steps", "seconds"; "spl95": {"episodes", "steps", "seconds"} or null. Of a control:
/// [{"traversal", SCORE}]. SCORE: tasks, completed, spl, excess, steps, reward. All but the seconds are the same again
/// with the same seed.
Unit unit_of(const Study& study, World& world);

/// {"slip", "dropped_frames", "kidnappings"}.
Json as_json(const Imperfections& world);

}  // namespace citylearn::paper
