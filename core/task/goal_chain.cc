// SPDX-License-Identifier: Apache-2.0
#include "core/task/goal_chain.h"

#include <algorithm>
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

std::vector<std::uint16_t> steps_on(const StateMap& map, const std::vector<int>& goals,
                                    const std::vector<std::uint16_t>& on) {
  std::vector<std::pair<int, int>> ends;  // steps on from a state of a goal, and the state
  for (int state = 0; state < map.states(); ++state)
    if (std::find(goals.begin(), goals.end(), map.place(state)) != goals.end())
      ends.emplace_back(on[static_cast<std::size_t>(state)], state);
  std::sort(ends.begin(), ends.end());
  std::vector<std::uint16_t> steps(on.size(), StateMap::kNoWay);
  std::vector<int> queue;  // by rising steps
  queue.reserve(steps.size());
  const auto steps_at = [&](std::size_t head) { return int{steps[static_cast<std::size_t>(queue[head])]}; };
  const auto reach = [&](int state, int count) {
    std::uint16_t& known = steps[static_cast<std::size_t>(state)];
    if (known != StateMap::kNoWay || count >= StateMap::kNoWay) return;
    known = static_cast<std::uint16_t>(count);
    queue.push_back(state);
  };
  auto end = ends.begin();
  for (std::size_t head = 0; head < queue.size() || end != ends.end(); ++head) {
    for (; end != ends.end() && (head == queue.size() || end->first <= steps_at(head)); ++end)
      reach(end->second, end->first);
    if (head == queue.size()) break;  // no way on from the ends that are left
    const auto [first, last] = map.before(queue[head]);
    for (const int* from = first; from != last; ++from) reach(*from, steps_at(head) + 1);
  }
  return steps;
}

DistanceField way_through(const StateMap& streets, float radius, std::span<const int> goals) {
  std::vector<std::uint16_t> steps(static_cast<std::size_t>(streets.states()), 0);
  for (std::size_t left = goals.size(); left > 0; --left)
    steps = steps_on(streets, streets.places_around(goals[left - 1], radius), steps);
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
