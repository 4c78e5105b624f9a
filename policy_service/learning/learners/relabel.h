// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/task/reward.h"
#include "core/task/state_map.h"
#include "core/util/random.h"
#include "policy_service/learning/optimization/gradient_step.h"
#include "policy_service/learning/optimization/replay.h"
#include "policy_service/learning/optimization/vtrace_loss.h"

namespace citylearn {

/// Where a replay's steps led, and how far that was from goals, at the goals' own places whatever the radius is. Used
/// by one thread.
struct RelabelMap {
  std::shared_ptr<const StateMap> states;
  DistanceFields fields = DistanceFields(*states);
};

/// A goal for an episode that begins at step `begin` of a stored sequence: with probability `visited` one of the places
/// that the walk comes by later in the same stretch, else any other place to which there is a way.
inline int choose_goal(const Replay& replay, std::size_t slot, int begin, double visited, RelabelMap& map,
                       Random& random) {
  constexpr int kMaxTries = 1000;
  const int state = replay.position(replay.at(slot, begin)), here = map.states->place(state);
  if (random.uniform() < visited) {
    int end = begin + 1;  // one beyond the stretch
    while (end < replay.sequence() && replay.ended(replay.at(slot, end - 1)) == Rollout::kGoesOn) ++end;
    const int later = begin + 1 + static_cast<int>(random.below(static_cast<std::uint64_t>(end - begin)));
    const int place = map.states->place(replay.position(replay.at(slot, std::min(later, replay.sequence()))));
    if (place != here) return place;
  }
  for (int tries = 0;; ++tries) {
    int goal = static_cast<int>(random.below(static_cast<std::uint64_t>(map.states->places() - 1)));
    goal += goal >= here ? 1 : 0;
    if (map.fields.to(goal).reaches(state) || tries == kMaxTries) return goal;
  }
}

/// Returns whether the agent was carried: an action done never, once or twice cannot lead from `here` to `there`.
inline bool was_carried(const StateMap& map, int here, std::uint8_t action, int there) {
  return there != here && there != map.after(here, action, 1) && there != map.after(here, action, 2);
}

/// Replays a stored sequence with other goals, as agent b of a shard of a minibatch (L + 1 steps). What was seen and
/// done stays; an episode begins at its first step, with the memory wiped and no previous action, and anew wherever the
/// goal is reached, the steps allowed are used up, or the real episode ended, as the frames' disguise changes there. In
/// the latter two cases the walk stops for one column to value what the episode would have gone on with. So it does
/// where the agent is carried (--kidnappings) to the other goal, because no agent is carried to a goal. The learner
/// gets each reward as `told` says, which also limits episodes to a multiple of their fewest steps.
inline void relabel(const Replay& replay, std::size_t slot, double visited, const Rollout& told, RelabelMap& map,
                    Random& random, int b, GradientStep::Shard& shard, TrajectoryBatch<float>& trajectories) {
  const int length = replay.sequence();
  const std::ptrdiff_t batch = shard.inputs.agents;
  shard.state.col(b).setZero();
  int t = 0, goal = 0;
  bool begins = true, breaks_off = false;
  EpisodeReward reward(0, 1);
  DistanceField distance;
  for (int row = 0; row <= length; ++row) {
    const std::size_t from = replay.at(slot, t);
    const auto column = static_cast<std::ptrdiff_t>(row) * batch + b;
    const auto to = static_cast<std::size_t>(column);
    if (begins) {
      goal = choose_goal(replay, slot, t, visited, map, random);
      distance = map.fields.to(goal);
      const int fewest = distance(replay.position(from));
      reward = {fewest, told.limit(fewest)};
    }
    shard.inputs.see(column, replay.shown(from), replay.seen(from));
    shard.inputs.position[to] = replay.position(from);
    shard.inputs.allowed[to] = replay.allowed(from);
    shard.inputs.goal[to] = goal;
    shard.inputs.first[to] = begins;
    shard.inputs.previous_action[to] = begins ? static_cast<std::uint8_t>(kNoAction) : replay.action(from - 1);
    trajectories.action[to] = kNoAction;
    if (breaks_off) {  // the same is seen again, as a new episode's first
      breaks_off = false;
      begins = true;
      continue;
    }
    begins = false;
    if (row == length) break;
    trajectories.action[to] = replay.action(from);
    trajectories.log_probability[to] = replay.log_probability(from);
    trajectories.final_value[to] = 0;
    ++t;
    const int here = replay.position(from), there = replay.position(from + 1);
    const bool carried = was_carried(*map.states, here, replay.action(from), there);
    // Agents are carried after a step, whose reward is that of the place it led to.
    const int stepped_to = carried ? map.states->after(here, replay.action(from), 1) : there;
    trajectories.reward[to] = told.learned(reward.step(distance(stepped_to)));
    trajectories.ended[to] = reward.reached() ? Rollout::kTerminated : Rollout::kGoesOn;
    begins = reward.reached();
    if (carried && !begins) reward.displace(distance(there));
    breaks_off = !begins && (reward.reached() || replay.ended(from) != Rollout::kGoesOn || reward.out_of_steps());
  }
}

}  // namespace citylearn
