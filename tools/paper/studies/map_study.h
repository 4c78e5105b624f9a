// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "tools/paper/studies/map_layout.h"
#include "tools/paper/work.h"
#include "tools/paper/world.h"

namespace citylearn::paper {

/// One policy on a route that crosses itself, or on the same route without its junctions. All policies have the same
/// tasks, with a limit of N steps.
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
  double seconds = 30;                  ///< estimate
};

/// Returns its unit of work. Outcome:
/// "trials": [{"traversal", "completed", "spl", "steps", "shortest"}], an ESTIMATE over tasks each: SPL against the
/// shortest path with junctions, whether the agent has them or not; "shortest": the path that it could have taken.
/// "walk": {"start", "goal", "places"} on the traversal learned from, of the task for which junctions save most: where
/// it went. Of networks also "curve": {"episodes", "spl"}, a number an update: means over the episodes that ended in it
/// (null where none did); "episodes", "steps".
/// ESTIMATE: {"mean", "low", "high", "n"}.
Unit unit_of(const MapStudy& study, World& world);

}  // namespace citylearn::paper
