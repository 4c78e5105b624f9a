// SPDX-License-Identifier: Apache-2.0
#include <utility>

#include "policy_service/network/belief/street_votes.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

/// Ignores what it sees: walks to the end that is nearer to the goal's number and turns round where the mask shows the
/// end. On 128 frames it completes every task with SPL .85, so an agent must do clearly better to count as navigating.
/// At a goal it knows where it is, and turns to the next one.
class Blind : public Policy {
 public:
  explicit Blind(const ControlTask& task) : task_(task) {}

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    const std::size_t agents = observation.goal().size();
    heading_.resize(agents, kNext);
    goal_.resize(agents);
    choice.resize(agents);
    for (std::size_t i = 0; i < agents; ++i) {
      const int goal = static_cast<int>(observation.goal()[i]) - task_.first_frame;
      if (observation.flags()[i] & msg::FLAG_FIRST)
        heading_[i] = goal < task_.frames / 2 ? kPrevious : kNext;
      else if (goal != goal_[i])
        heading_[i] = goal < goal_[i] ? kPrevious : kNext;
      goal_[i] = goal;
      choice[i] = heading_[i] = allowed_or_turn(heading_[i], observation.allowed()[i]);
    }
  }

 private:
  ControlTask task_;
  std::vector<std::uint8_t> heading_;
  std::vector<int> goal_;
};

/// Ignores what it sees on streets: it is told where it starts, knows the map, and always walks to the nearest place
/// where it has not been since the last goal.
class BlindOnStreets : public Policy {
 public:
  explicit BlindOnStreets(std::shared_ptr<const StateMap> streets)
      : map_(std::move(streets)), from_(static_cast<std::size_t>(map_->states())) {}

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    agents_.resize(observation.goal().size());
    choice.assign(agents_.size(), kForward);
    for (std::size_t i = 0; i < agents_.size(); ++i) {
      if (observation.flags()[i] & msg::FLAG_IDLE) continue;
      Agent& agent = agents_[i];
      const std::uint8_t previous = observation.previous_action()[i];
      if (observation.flags()[i] & msg::FLAG_FIRST)
        agent.state = static_cast<int>(observation.position()[i]);
      else if (previous < kActions)
        agent.state = map_->after(agent.state, previous, 1);
      if (observation.flags()[i] & msg::FLAG_FIRST || agent.goal != observation.goal()[i]) {
        agent.goal = observation.goal()[i];
        agent.visited.assign(static_cast<std::size_t>(map_->places()), false);
        agent.plan.clear();
      }
      agent.visited[static_cast<std::size_t>(map_->place(agent.state))] = true;
      if (agent.plan.empty()) make_plan(agent);
      const std::uint8_t planned = agent.plan.empty() ? +kForward : agent.plan.back();
      choice[i] = allowed_or_other(planned, observation.allowed()[i]);
      if (choice[i] != planned)
        agent.plan.clear();  // it has slipped before
      else if (!agent.plan.empty())
        agent.plan.pop_back();
    }
  }

 private:
  struct Agent {
    int state = 0;
    std::uint32_t goal = 0;
    std::vector<bool> visited;       // P
    std::vector<std::uint8_t> plan;  // the next action stands last
  };
  struct Step {
    int state = -1;  // from which the search came here; -1: it did not
    std::uint8_t action = 0;
  };

  void make_plan(Agent& agent) {
    queue_.assign(1, agent.state);
    int found = -1;
    for (std::size_t head = 0; head < queue_.size() && found < 0; ++head)
      for (const std::uint8_t action : kStreetActions) {
        const int to = map_->next(queue_[head], action);
        if (to < 0 || to == agent.state || from_[static_cast<std::size_t>(to)].state >= 0) continue;
        from_[static_cast<std::size_t>(to)] = {queue_[head], action};
        queue_.push_back(to);
        if (agent.visited[static_cast<std::size_t>(map_->place(to))]) continue;
        found = to;
        break;
      }
    for (int state = found; found >= 0 && state != agent.state; state = from_[static_cast<std::size_t>(state)].state)
      agent.plan.push_back(from_[static_cast<std::size_t>(state)].action);
    for (const int state : queue_) from_[static_cast<std::size_t>(state)] = {};
  }

  std::shared_ptr<const StateMap> map_;
  std::vector<Agent> agents_;
  std::vector<Step> from_;  // S
  std::vector<int> queue_;
};

const ControlRegistry::Registration blind_registration({
    "blind",
    "ignores the images: walks towards the goal's half, turns round at the end; on streets it is told its start and "
    "walks to the nearest place where it has not been",
    {},
    [](const Parameters&, const ControlTask& task) -> std::unique_ptr<Policy> {
      if (task.streets) return std::make_unique<BlindOnStreets>(task.streets);
      return std::make_unique<Blind>(task);
    },
});

}  // namespace
}  // namespace citylearn
