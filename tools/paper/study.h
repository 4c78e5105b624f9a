#pragma once

#include <string>
#include <vector>

#include "tools/inprocess/training.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// One training and its trials.
struct Study {
  std::string agent, learner = "ppo";
  std::string representation;
  int first = 0, frames = 128;  ///< the route; N steps are the limit of its tasks
  std::uint64_t seed = 1;
  std::uint64_t steps = 0;              ///< of training; 0: the agent's recommendation
  int deploy_every = 0;                 ///< episodes between trials while it trains; 0: none
  int tasks = 2000;                     ///< of the trials at the end
  int tasks_between = 200;              ///< of those while it trains
  std::vector<std::string> traversals;  ///< that it is tried on
  double seconds = 30;                  ///< guessed
};

/// The unit of work of a study. Its outcome:
/// "curve": {"episodes", "steps", "seconds", "reward", "spl", "length"}, a number an update: means over the episodes
/// that ended in it (null where none did); "deployments": [{"episodes", "traversal", SCORE}]; "trials": [{"traversal",
/// "shuffled", SCORE}], those not shuffled with "walk" (walk.h); "episodes", "steps", "seconds"; "spl95": {"episodes",
/// "steps", "seconds"} or null. SCORE: tasks, completed, spl, excess, steps, reward. All but the seconds are the same
/// again with the same seed.
Unit unit_of(const Study& study, World& world);

/// Likewise for policies that learn nothing: blind, shortest_path, sequence_filter on a route. Outcome: [{"traversal",
/// SCORE}].
struct ControlStudy {
  std::string control, representation;
  int first = 0, frames = 128, tasks = 2000;
  std::vector<std::string> traversals;
};
Unit unit_of(const ControlStudy& study, World& world);

}  // namespace citylearn::paper
