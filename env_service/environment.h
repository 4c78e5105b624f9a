// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "core/task/state_map.h"
#include "core/wire/messages.h"
#include "env_service/agent_state.h"
#include "env_service/imperfections.h"
#include "env_service/live/sighting.h"
#include "env_service/traversal/traversal.h"

namespace citylearn {

/// The navigation task of CityLearn (Chancan & Milford, ICRA 2020; reward after the authors' released environment) for
/// M agents on one traversal. An agent stands at a frame; it stays, moves to the next frame or to the previous one. On
/// streets it stands in a state, whose frame it sees; it goes forward, or turns to the left or right (StateMap), and
/// its goal is a place. Distances are the fewest steps.
///
/// Reward: +1 on reaching the goal. That ends the episode, or the agent gets the task's next goal. A step that leads
/// nearer to the goal than it ever was since it has it costs nothing; every other step costs 1 / max_steps. After
/// max_steps steps for each goal the episode is cut (truncated). On streets settings may limit it to a multiple of its
/// fewest steps too, whichever limit is lower; this is max_steps then.
///
/// Imperfections make agents slip, see old frames, or suddenly stand elsewhere ("kidnapped"), never at their goal. An
/// agent that slips over its goal has not reached it. The shortest path is still the one from the start.
/// It has no threads, wire or clock: the same settings and actions give the same observations.
class Environment {
 public:
  struct Episode {  ///< a finished one; its goal is the last
    int agent, task, start, goal, steps, shortest;
    float reward;
    bool completed;
    std::vector<std::uint8_t> path;  ///< its actions, as EpisodeStat describes; may be empty
  };

  /// `traversal` must outlive the environment and stay as it is. `goals`: of a task, 1..kMaxGoals. Throws Error unless
  /// 1 <= agents <= msg::MAX_AGENTS and its streets, if any, have a state for each frame.
  Environment(const Traversal& traversal, int agents, const Imperfections& imperfections = {}, int goals = 1);

  /// Begins anew under `settings` (mode TRAIN or EVALUATE). Throws Error naming the field when the route
  /// first_frame .. first_frame + frames - 1 does not lie on the traversal or has fewer than 2 frames, the mode is
  /// IDLE, streets are not asked for as a whole or are to be shuffled, max_steps or (EVALUATE) tasks are not 1..2^30,
  /// or agents x D do not fit one observation that is not by_reference.
  void reset(const msg::TaskSettings& settings);
  /// Lets evaluations have up to `most` agents where they have so many tasks, and never fewer than M.
  void allow_evaluation_agents(int most) { evaluation_agents_ = most; }

  /// Returns the features of a frame: D.
  std::span<const float> feature(int frame) const;

  /// Performs one action per agent. An agent at the start of its episode may be given kNoAction: it waits unchanged.
  /// Throws Error, changing nothing, for a wrong number of actions or a masked or unknown one.
  void step(std::span<const std::uint8_t> actions);
  /// Throws Error as step() does.
  void check(std::span<const std::uint8_t> actions) const;

  /// Makes agent 0 a robot that stands where `sighting` says: its steps lead there and its episodes begin there. A
  /// place beyond the route counts as the route's nearest end.
  void set_robot_pose(const Sighting& sighting) { robot_ = sighting; }
  /// Makes an episode of agent 0, a robot, begin only when set_next_goal() gives it a goal. Until then it is idle.
  void use_external_goals() { external_goals_ = true; }
  /// Sets the goal, a place, of the robot's next episode, or none. The next step ends the running one (truncated).
  void set_next_goal(std::optional<int> place) { next_goal_ = place; }
  bool is_sent() const { return next_goal_.has_value(); }  ///< whether a goal is set for which no episode has begun
  /// Returns whether the robot has tasks left but no goal.
  bool awaits_goal() const;
  /// Returns the frame to which an agent goes.
  int goal(int agent) const;
  /// Returns the frame at which an agent stands, and the one to which the action leads if it does not slip.
  std::pair<int, int> way(int agent, std::uint8_t action) const;

  /// Fills everything but the header.
  void observe(msg::Observation& observation) const;
  void observe(msg::Scene& scene) const;  ///< Fills the step and the sequences of agents.

  const std::vector<Episode>& finished() const { return finished_; }  ///< that the last step ended, by agent
  bool done() const;                                                  ///< whether every task of mode EVALUATE is
  std::uint64_t ticks() const { return step_; }                       ///< steps under the present settings
  int agents() const { return static_cast<int>(agents_.size()); }     ///< under the present settings; at first M
  const Traversal& traversal() const { return traversal_; }
  std::uint64_t traversal_hash() const { return traversal_hash_; }

 private:
  void begin_episode(AgentState& agent);
  void begin_task(AgentState& agent, int task);
  int state_to_begin(AgentState& agent);
  bool leads(int state, int goal);
  int goal_to_begin(AgentState& agent);
  void aim(AgentState& agent);
  int on_route(int place) const;
  bool is_unmatched(int place) const;
  void move(AgentState& agent, std::uint8_t action);
  void kidnap(AgentState& agent);
  void look(AgentState& agent) const;
  static bool waits(const AgentState& agent, std::uint8_t action) { return action == kNoAction && agent.steps == 0; }

  const Traversal& traversal_;
  const std::uint64_t traversal_hash_;
  const Imperfections imperfections_;
  const int goals_, announced_agents_;
  int evaluation_agents_ = 0;                      // at most
  const std::shared_ptr<const StateMap> streets_;  // null: a line, whose length the settings say
  std::shared_ptr<const StateMap> map_;            // of the settings in force
  std::optional<DistanceFields> fields_;           // likewise
  msg::TaskSettings settings_;
  std::vector<AgentState> agents_;
  std::vector<Episode> finished_;
  std::uint64_t step_ = 0;
  std::optional<Sighting> robot_;
  bool external_goals_ = false;  // goals come from set_next_goal()
  std::optional<int> next_goal_;
};

}  // namespace citylearn
