// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <span>
#include <vector>

#include "core/plugin/registry.h"
#include "core/task/goal_chain.h"
#include "policy_service/network/network_inputs.h"
#include "policy_service/rollout/policy.h"

namespace citylearn {

/// The route of a control policy. Places are counted from the route's first frame.
struct ControlTask {
  int first_frame = 0;  ///< of the route, index on the traversal
  int frames = 0;       ///< N, places on the route; on streets their states
  /// D x EN, features of the route on the training traversals (for oracle_filter: on the one walked on), as
  /// NetworkTask.
  Matrix<float> reference = {};
  int sparse_from = kSparsePlaces;               ///< as NetworkTask
  std::shared_ptr<const StateMap> streets = {};  ///< likewise
  float goal_radius = 0;                         ///< likewise
};

/// Policies that learn nothing: the references for every result of a learned agent.
using ControlRegistry = Registry<Policy, const ControlTask&>;

/// The goals of one agent's episodes on streets, for controls that know those to come.
struct KnownGoals {
  std::vector<int> goals;  ///< of the episode
  DistanceField way;       ///< through those that are left

  /// Takes in an observation that begins an episode or has another goal than the one before.
  void follow(const ControlTask& task, DistanceFields& fields, const msg::Observation& seen, std::size_t agent) {
    const int goal = static_cast<int>(seen.goal()[agent]);
    const std::size_t left = 1u + seen.flags()[agent] / kLaterGoal;
    if (seen.flags()[agent] & msg::FLAG_FIRST)
      goals = draw_goals(*task.streets, fields, static_cast<int>(seen.position()[agent]), goal, static_cast<int>(left));
    way = left > 1 && left <= goals.size() ? way_through(*task.streets, task.goal_radius, std::span(goals).last(left))
                                           : fields.to(goal);
  }
};

/// Returns `action` if it is allowed on a line, else the opposite direction (on a route of 2 or more frames one of them
/// is).
inline std::uint8_t allowed_or_turn(std::uint8_t action, std::uint8_t allowed) {
  if (allowed >> action & 1) return action;
  return action == kNext ? kPrevious : kNext;
}

}  // namespace citylearn
