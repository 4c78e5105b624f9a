// SPDX-License-Identifier: Apache-2.0
#include <optional>

#include "policy_service/network/street_votes.h"
#include "policy_service/rollout/control.h"

namespace citylearn {
namespace {

/// Sees its true position: the bound no agent can beat.
class ShortestPath : public Policy {
 public:
  explicit ShortestPath(const ControlTask& task) : streets_(task.streets) {
    if (streets_) fields_.emplace(*streets_, task.goal_radius);
  }

  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override {
    choice.resize(observation.goal().size());
    for (std::size_t i = 0; i < choice.size(); ++i) {
      const int position = static_cast<int>(observation.position()[i]), goal = static_cast<int>(observation.goal()[i]);
      choice[i] = streets_ ? allowed_or_other(way_to(fields_->to(goal), *streets_, position), observation.allowed()[i])
                           : allowed_or_turn(position < goal ? kNext : kPrevious, observation.allowed()[i]);
    }
  }

 private:
  std::shared_ptr<const StateMap> streets_;  // null: a line
  std::optional<DistanceFields> fields_;     // on streets
};

const ControlRegistry::Registration shortest_path_registration({
    "shortest_path",
    "knows its true position: the bound",
    {},
    [](const Parameters&, const ControlTask& task) { return std::make_unique<ShortestPath>(task); },
});

}  // namespace
}  // namespace citylearn
