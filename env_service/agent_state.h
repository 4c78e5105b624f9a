// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/task/action.h"
#include "core/task/reward.h"
#include "core/task/state_map.h"
#include "core/util/random.h"
#include "env_service/imperfections.h"

namespace citylearn {

/// An agent of an Environment. Frames are those of the route, from 0; so is the goal, which is a place on streets.
struct AgentState {
  Random random = Random(0);
  Mishaps mishaps;
  int task = 0, start = 0, frame = 0, goal = 0, steps = 0;
  std::vector<int> later;  ///< goals that follow, the next one last
  int fewest = 0;          ///< steps from the start to the last goal
  int shown = 0;           ///< frame of the route that it sees
  DistanceField distance;  ///< to the goal
  EpisodeReward rule = {0, 1};
  float episode_reward = 0, reward = 0;
  std::uint8_t previous_action = kNoAction, flags = 0;
  std::vector<int> order;          ///< frame shown at each place of the route, when shuffled
  std::vector<std::uint8_t> path;  ///< of the episode so far, 2 bits an action
  bool strayed = false;            ///< in this episode it was moved elsewhere than its actions say
};

}  // namespace citylearn
