// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/map_layout.h"
#include "tools/paper/statistics.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// One policy on a route that crosses itself, or on the same route without its junctions. N steps are the limit of its
/// tasks, which are the same for all.
struct MapStudy {
  std::string policy;  ///< a network to be trained with ppo, or a control, which learns nothing
  bool learns = true;
  bool junctions = true;  ///< the agent can turn at them, and its network or control knows them
  std::string representation;
  Layout layout;
  std::uint64_t seed = 1;
  std::uint64_t steps = 0;  ///< of training
  int tasks = 2000;
  std::vector<std::string> traversals;  ///< that it is tried on
  double seconds = 30;                  ///< guessed
};

/// Its unit of work. Outcome:
/// "trials": [{"traversal", "completed", "spl", "steps", "shortest"}], an ESTIMATE over tasks each: SPL against the
/// shortest way with junctions, whether the agent has them or not; "shortest": the way that it could have taken.
/// "walk": {"start", "goal", "places"} on the traversal learned from, of the task for which junctions save most: where
/// it went. Of networks also "curve": {"episodes", "spl"}, a number an update: means over the episodes that ended in it
/// (null where none did); "episodes", "steps".
/// ESTIMATE: {"mean", "low", "high", "n"}.
Unit unit_of(const MapStudy& study, World& world);

Json as_json(const Estimate& estimate);
Estimate estimate_of(const Json& json);

}  // namespace citylearn::paper
