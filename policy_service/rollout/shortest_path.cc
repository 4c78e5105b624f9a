// SPDX-License-Identifier: Apache-2.0
#include <map>

#include "core/task/route_map.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

/// Sees its true position: the bound no agent can beat.
class ShortestPath : public Policy {
 public:
  explicit ShortestPath(const ControlTask& task) : task_(task) { check_turns(task.turns, task.frames); }

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    choice.resize(observation.goal().size());
    for (std::size_t i = 0; i < choice.size(); ++i) {
      if (!task_.turns.empty())
        choice[i] = on_the_map(static_cast<int>(observation.position()[i]) - task_.first_frame,
                               static_cast<int>(observation.goal()[i]) - task_.first_frame, observation.allowed()[i]);
      else
        choice[i] = allowed_or_turn(observation.position()[i] < observation.goal()[i] ? kNext : kPrevious,
                                    observation.allowed()[i]);
    }
  }

 private:
  /// Returns the first of next, previous and turning that leads nearer.
  std::uint8_t on_the_map(int place, int goal, std::uint8_t allowed) {
    std::vector<int>& distances = distances_[goal];
    if (distances.empty()) distances_to(goal, task_.frames, task_.turns, distances);
    const auto distance = [&](int at) { return distances[static_cast<std::size_t>(at)]; };
    for (const std::uint8_t action : {kNext, kPrevious})
      if (allowed >> action & 1 && distance(place_after(place, action, task_.turns)) < distance(place)) return action;
    return kStay;
  }

  ControlTask task_;
  std::map<int, std::vector<int>> distances_;  ///< by goal
};

const ControlRegistry::Registration shortest_path_registration({
    "shortest_path",
    "knows its true position: the bound",
    {},
    [](const Parameters&, const ControlTask& task) { return std::make_unique<ShortestPath>(task); },
});

}  // namespace
}  // namespace citylearn
