// SPDX-License-Identifier: Apache-2.0
#include "core/task/state_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <string>

#include "core/util/error.h"

namespace citylearn {
namespace {

constexpr float kReach = 30;  // degrees to either side within which one goes forward
constexpr int kHops = 3;      // links within which StreetLearn looks for the next place

/// Returns the angle between two headings, 0..180 degrees.
float between(float a, float b) {
  const float difference = std::abs(a - b);
  return std::min(difference, 360 - difference);
}

}  // namespace

StateMap::StateMap(const StreetMap& streets, StateRule rule, std::size_t most)
    : places_(static_cast<int>(streets.places())), states_(0), east_(streets.east), north_(streets.north) {
  const std::size_t states = rule == StateRule::kStreet ? streets.links() : streets.places() * kHeadings;
  if (states > most)
    throw Error("has " + std::to_string(states) + " states, more than " + std::to_string(most), "street map",
                "choose a part of it, or the rule street");
  states_ = static_cast<int>(states);
  place_.reserve(states);
  next_.reserve(states);
  heading_.reserve(states);
  if (rule == StateRule::kStreet)
    add_link_headings(streets);
  else
    add_fixed_headings(streets, rule == StateRule::kStreetLearn);
  add_predecessors();
}

void StateMap::add_link_headings(const StreetMap& streets) {
  const std::vector<std::uint32_t> first = streets.first_links();
  first_state_.assign(first.begin(), first.end());
  for (std::size_t link = 0; link < streets.links(); ++link) {
    const std::uint32_t place = streets.from[link], to = streets.to[link];
    const float heading = streets.heading[link];
    std::uint32_t ahead = first[to];
    for (std::uint32_t other = first[to]; other < first[to + 1]; ++other)
      if (between(streets.heading[other], heading) < between(streets.heading[ahead], heading)) ahead = other;
    const int begin = first_state_[place], count = first_state_[place + 1] - begin;
    const int index = static_cast<int>(link) - begin;
    const auto turned = [&](int by) { return count > 1 ? begin + (index + by + count) % count : -1; };
    place_.push_back(static_cast<int>(place));
    heading_.push_back(heading);
    next_.push_back({turned(-1), static_cast<int>(ahead), turned(1)});
  }
  starts_.resize(next_.size());
  std::iota(starts_.begin(), starts_.end(), 0);
}

void StateMap::add_fixed_headings(const StreetMap& streets, bool by_place) {
  const std::vector<std::uint32_t> first = streets.first_links();
  struct Way {
    int to;
    float heading, rank;  // the least rank within reach is taken
  };
  std::vector<Way> ways;
  std::vector<std::uint32_t> near;
  for (std::uint32_t place = 0; place < streets.places(); ++place) {
    ways.clear();
    if (by_place) {
      near = {place};
      for (std::size_t hop = 0, begin = 0; hop < kHops; ++hop) {
        const std::size_t end = near.size();
        for (; begin < end; ++begin)
          for (std::uint32_t link = first[near[begin]]; link < first[near[begin] + 1]; ++link)
            if (std::find(near.begin(), near.end(), streets.to[link]) == near.end()) near.push_back(streets.to[link]);
      }
      for (const std::uint32_t other : near) {
        const float east = east_[other] - east_[place], north = north_[other] - north_[place];
        if (east == 0 && north == 0) continue;  // itself, or one at the same spot: it lies in no direction
        const float degrees = std::atan2(east, north) * 180 / std::numbers::pi_v<float>;
        ways.push_back({static_cast<int>(other), degrees < 0 ? degrees + 360 : degrees, std::hypot(east, north)});
      }
    } else {
      for (std::uint32_t link = first[place]; link < first[place + 1]; ++link)
        ways.push_back({static_cast<int>(streets.to[link]), streets.heading[link], 0});
    }
    first_state_.push_back(static_cast<int>(place_.size()));
    bool left = false;
    for (int index = 0; index < kHeadings; ++index) {
      const float heading = 360.0f / kHeadings * static_cast<float>(index);
      int ahead = -1;
      float least = std::numeric_limits<float>::max();
      for (const Way& way : ways) {
        const float off = between(way.heading, heading), rank = by_place ? way.rank : off;
        if (off >= kReach || rank >= least) continue;
        least = rank;
        ahead = way.to * kHeadings + index;
      }
      const int here = static_cast<int>(place) * kHeadings;
      place_.push_back(static_cast<int>(place));
      heading_.push_back(heading);
      next_.push_back({here + (index + kHeadings - 1) % kHeadings, ahead, here + (index + 1) % kHeadings});
      left = left || ahead >= 0;
    }
    for (int index = 0; left && index < (by_place ? 1 : kHeadings); ++index)
      starts_.push_back(static_cast<int>(place) * kHeadings + index);
  }
  first_state_.push_back(states_);
  if (starts_.empty()) throw Error("no place of it can be left", "street map");
}

void StateMap::add_predecessors() {
  first_before_.assign(static_cast<std::size_t>(states_) + 1, 0);
  const auto each = [&](auto&& use) {
    for (int state = 0; state < states_; ++state)
      for (const int to : next_[static_cast<std::size_t>(state)])
        if (to >= 0) use(static_cast<std::size_t>(to), state);
  };
  each([&](std::size_t to, int) { ++first_before_[to + 1]; });
  std::partial_sum(first_before_.begin(), first_before_.end(), first_before_.begin());
  before_.resize(static_cast<std::size_t>(first_before_.back()));
  std::vector<int> at(first_before_.begin(), first_before_.end() - 1);
  each([&](std::size_t to, int state) { before_[static_cast<std::size_t>(at[to]++)] = state; });
}

int StateMap::after(int state, std::uint8_t action, int times) const {
  for (int i = 0; i < times; ++i)
    if (const int to = next(state, action); to >= 0) state = to;
  return state;
}

std::uint8_t StateMap::allowed(int state) const {
  std::uint8_t mask = 0;
  for (std::uint8_t action = 0; action < kActions; ++action)
    mask = static_cast<std::uint8_t>(mask | (next(state, action) >= 0) << action);
  return mask;
}

std::vector<std::uint16_t> StateMap::steps_to(const std::vector<int>& goals,
                                              const std::vector<std::uint16_t>& on) const {
  std::vector<std::pair<int, int>> ends;  // steps on from a state of a goal, and the state
  for (int state = 0; state < states_; ++state)
    if (std::find(goals.begin(), goals.end(), place(state)) != goals.end())
      ends.emplace_back(on.empty() ? 0 : on[static_cast<std::size_t>(state)], state);
  std::sort(ends.begin(), ends.end());
  std::vector<std::uint16_t> steps(static_cast<std::size_t>(states_), kNoWay);
  std::vector<int> queue;  // by rising steps
  queue.reserve(steps.size());
  const auto steps_at = [&](std::size_t head) { return int{steps[static_cast<std::size_t>(queue[head])]}; };
  const auto reach = [&](int state, int count) {
    std::uint16_t& known = steps[static_cast<std::size_t>(state)];
    if (known != kNoWay || count >= kNoWay) return;
    known = static_cast<std::uint16_t>(count);
    queue.push_back(state);
  };
  auto end = ends.begin();
  for (std::size_t head = 0; head < queue.size() || end != ends.end(); ++head) {
    for (; end != ends.end() && (head == queue.size() || end->first <= steps_at(head)); ++end)
      reach(end->second, end->first);
    if (head == queue.size()) break;  // no way on from the ends that are left
    const auto [first, last] = before(queue[head]);
    for (const int* from = first; from != last; ++from) reach(*from, steps_at(head) + 1);
  }
  return steps;
}

std::vector<int> StateMap::places_around(int place, float radius) const {
  std::vector<int> around{place};
  const auto at = static_cast<std::size_t>(place);
  for (std::size_t other = 0; radius > 0 && other < east_.size(); ++other)
    if (other != at && std::hypot(east_[other] - east_[at], north_[other] - north_[at]) <= radius)
      around.push_back(static_cast<int>(other));
  return around;
}

DistanceField DistanceFields::to(int goal) {
  if (map_.line()) return DistanceField(goal);
  if (goal < 0 || goal >= map_.places())
    throw Error("is place " + std::to_string(goal) + " of " + std::to_string(map_.places()), "goal");
  const auto found = std::find_if(fields_.begin(), fields_.end(), [&](const Kept& kept) { return kept.first == goal; });
  if (found != fields_.end()) {
    fields_.splice(fields_.begin(), fields_, found);
  } else {
    fields_.emplace_front(
        goal, std::make_shared<const std::vector<std::uint16_t>>(map_.steps_to(map_.places_around(goal, radius_))));
    if (fields_.size() > kept_) fields_.pop_back();
  }
  return DistanceField(fields_.front().second);
}

}  // namespace citylearn
