// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "traversal.h"

namespace CLI {
class App;
}

namespace citylearn {

/// Returns the traversal with a place to which all tasks lead, and a name that says so, "summer-goal31", so that
/// results are not mixed. `goal` is one of
/// - "31", the place's number: on a line a frame, on streets a line of nodes.txt, from 0;
/// - "LAT,LON" or "LAT,LON,METRES": the nearest place to this position (degrees, WGS 84), at most METRES away, else 50;
/// - a file of its pictures, "img-0031.png" or more of its path: the place that it shows.
/// Without a goal the traversal stays as it is. Throws Error naming the option where there is no such place.
Traversal with_goal(Traversal traversal, const std::string& goal);
/// Returns the traversal with a name that says how many goals tasks have, if several: "summer-goal31-goals3".
Traversal with_goals(Traversal traversal, int goals);
/// Returns a traversal's name without what these add: "summer-slip0.1" of "summer-goal31-goals3-slip0.1".
std::string without_goal(const std::string& name);

/// Adds --goals.
void add_goals_option(CLI::App& app, int& goals);

}  // namespace citylearn
