// SPDX-License-Identifier: Apache-2.0
#include "core/task/goal_chain.h"

#include <string>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

/// Returns whether from wherever one arrives at a goal the next can be reached, and is not reached yet.
bool leads_on(const StateMap& map, DistanceFields& fields, int goal, int next) {
  const DistanceField to_goal = fields.to(goal), to_next = fields.to(next);
  for (int state = 0; state < map.states(); ++state)
    if (to_goal(state) == 0 && (to_next(state) == 0 || !to_next.reaches(state))) return false;
  return true;
}

}  // namespace

DistanceField way_through(const StateMap& streets, float radius, std::span<const int> goals) {
  std::vector<std::uint16_t> steps;
  for (std::size_t left = goals.size(); left > 0; --left)
    steps = streets.steps_to(streets.places_around(goals[left - 1], radius), steps);
  return DistanceField(std::make_shared<const std::vector<std::uint16_t>>(std::move(steps)));
}

int fewest_steps(const StateMap& map, DistanceFields& fields, float radius, int start, std::span<const int> goals) {
  if (goals.size() == 1) return fields.to(goals.front())(start);
  if (!map.line()) return way_through(map, radius, goals)(start);
  int steps = 0;
  for (const int goal : goals) {
    steps += std::abs(goal - start);
    start = goal;
  }
  return steps;
}

std::vector<int> draw_goals(const StateMap& map, DistanceFields& fields, int start, int first, int count,
                            const std::function<bool(int)>& shown) {
  constexpr int kMaxTries = 1000;
  std::vector<int> goals{first};
  Random random{static_cast<std::uint64_t>(start), static_cast<std::uint64_t>(first)};
  for (int tries = 0; static_cast<int>(goals.size()) < count; ++tries) {
    const int here = goals.back();
    int drawn = static_cast<int>(random.below(static_cast<std::uint64_t>(map.places()) - 1));
    if (drawn >= here) ++drawn;
    if ((!shown || shown(drawn)) && (map.line() || leads_on(map, fields, here, drawn))) {
      goals.push_back(drawn);
      tries = 0;
    } else if (tries == kMaxTries) {
      throw Error("finds no goal that can be reached from place " + std::to_string(here), "--goals",
                  "leave out places without a way, or choose fewer goals or a lower goal radius");
    }
  }
  return goals;
}

}  // namespace citylearn
