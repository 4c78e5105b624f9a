// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "core/task/state_map.h"

namespace citylearn {

// The goals of an episode, which are places, reached one after the other. With which heading one arrives at a goal
// matters for the way on: the nearest way to it is not always the best.

constexpr int kMaxGoals = 16;  ///< of an episode
/// Observation.flags / kLaterGoal: how many goals follow the present one.
constexpr int kLaterGoal = 16;

/// Returns the field to the first of the goals, one or more, and from there to the next, up to the last; on streets,
/// where a goal is also reached at places within `radius` metres of it.
DistanceField way_through(const StateMap& streets, float radius, std::span<const int> goals);
/// Returns the fewest steps from a state through the goals. `fields` are those of the map, with that radius.
int fewest_steps(const StateMap& map, DistanceFields& fields, float radius, int start, std::span<const int> goals);

/// Returns the goals of an episode that begins in state `start`, `count` of them, of which `first` is the first. Each
/// other one is a place that can be reached, and is not reached yet, wherever one arrives at the goal before, and of
/// which `shown` is true. They are drawn from `start` and `first` alone: who sees an episode begin can tell them.
/// `fields` are those of the map. Throws Error where it finds none.
std::vector<int> draw_goals(const StateMap& map, DistanceFields& fields, int start, int first, int count,
                            const std::function<bool(int)>& shown = {});

}  // namespace citylearn
