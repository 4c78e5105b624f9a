// SPDX-License-Identifier: Apache-2.0
#include <optional>

#include "policy_service/network/belief/street_votes.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

/// Sees its true position and knows the goals to come: the bound no agent can beat.
class ShortestPath : public Policy {
 public:
  explicit ShortestPath(const ControlTask& task)
      : task_{task.first_frame, task.frames, {}, task.sparse_from, task.streets, task.goal_radius} {
    if (task_.streets) fields_.emplace(*task_.streets, task_.goal_radius);
  }

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    choice.resize(observation.goal().size());
    agents_.resize(choice.size());
    for (std::size_t i = 0; i < choice.size(); ++i) {
      const int position = static_cast<int>(observation.position()[i]), goal = static_cast<int>(observation.goal()[i]);
      if (!fields_) {
        choice[i] = allowed_or_turn(position < goal ? kNext : kPrevious, observation.allowed()[i]);
        continue;
      }
      Agent& agent = agents_[i];
      if (observation.flags()[i] & msg::FLAG_FIRST || goal != agent.goal)
        agent.known.follow(task_, *fields_, observation, i);
      agent.goal = goal;
      choice[i] = allowed_or_other(way_to(agent.known.way, *task_.streets, position), observation.allowed()[i]);
    }
  }

 private:
  struct Agent {
    int goal = -1;
    KnownGoals known;
  };

  const ControlTask task_;                // without the reference
  std::optional<DistanceFields> fields_;  // on streets
  std::vector<Agent> agents_;
};

const ControlRegistry::Registration shortest_path_registration({
    "shortest_path",
    "knows its true position, and goals to come: the bound",
    {},
    [](const Parameters&, const ControlTask& task) { return std::make_unique<ShortestPath>(task); },
});

}  // namespace
}  // namespace citylearn
