// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tools/inprocess/training.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// The agent that a study before has trained and kept.
struct Kept {
  Json study;  ///< spec of its unit
  const Work* work = nullptr;
};

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
  bool keep = false;                    ///< the trained parameters are in the outcome, for others to begin with
  std::optional<Kept> initial;          ///< the agent whose parameters it begins with; none: random ones
  std::vector<std::string> frozen;      ///< tensors, or beginnings of their names, that stay as they are
};

/// The unit of work of a study. Its outcome:
/// "curve": {"episodes", "steps", "seconds", "reward", "spl", "length"}, a number an update: means over the episodes
/// that ended in it (null where none did); "deployments": [{"episodes", "traversal", SCORE}]; "trials": [{"traversal",
/// "shuffled", SCORE}], those not shuffled with "walk" (walk.h); "episodes", "steps", "seconds"; "spl95": {"episodes",
/// "steps", "seconds"} or null; "parameters": text, where they are kept. SCORE: tasks, completed, spl, excess, steps,
/// reward. All but the seconds are the same again with the same seed.
Unit unit_of(const Study& study, World& world);

/// The agent of a study that keeps it; `work` does its unit before those that use it.
Kept kept(const Study& study, World& world, const Work& work);

/// That agent on another route or other recordings, as it is. On a route it has other knowledge of the places (their
/// features on the traversal learned from), the same parameters. Outcome: [{"traversal", SCORE}].
struct Carried {
  Kept agent;
  std::string representation;
  int first = 0, frames = 128, tasks = 2000;
  std::vector<std::string> traversals;
};
Unit unit_of(const Carried& carried, World& world);

/// Likewise for policies that learn nothing: blind, shortest_path, sequence_filter on a route. Outcome: [{"traversal",
/// SCORE}].
struct ControlStudy {
  std::string control, representation;
  int first = 0, frames = 128, tasks = 2000;
  std::vector<std::string> traversals;
};
Unit unit_of(const ControlStudy& study, World& world);

}  // namespace citylearn::paper
