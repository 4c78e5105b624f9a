// SPDX-License-Identifier: Apache-2.0
#include "core/task/route_map.h"

#include <string>

#include "core/task/action.h"
#include "core/util/error.h"

namespace citylearn {

void check_turns(const std::vector<int>& turns, int places) {
  if (turns.empty()) return;
  if (turns.size() != static_cast<std::size_t>(places))
    throw Error("are " + std::to_string(turns.size()) + " for " + std::to_string(places) + " places", "turns");
  std::vector<bool> led(turns.size(), false);
  for (std::size_t place = 0; place < turns.size(); ++place) {
    const int to = turns[place];
    if (to < 0 || to >= places || led[static_cast<std::size_t>(to)])
      throw Error("leads to " + std::to_string(to) + ", which is beside the route or led to already",
                  "turns[" + std::to_string(place) + "]", "each place must be led to once");
    led[static_cast<std::size_t>(to)] = true;
  }
}

std::vector<int> turns_within(const std::vector<int>& turns, int first, int frames) {
  if (turns.empty()) return {};
  std::vector<int> within;
  bool crosses = false;
  for (int place = 0; place < frames; ++place) {
    int to = turns[static_cast<std::size_t>(first + place)];
    while (to < first || to >= first + frames) to = turns[static_cast<std::size_t>(to)];
    crosses = crosses || to != first + place;
    within.push_back(to - first);
  }
  return crosses ? within : std::vector<int>();
}

int place_after(int place, std::uint8_t action, const std::vector<int>& turns) {
  if (action == kNext) return place + 1;
  if (action == kPrevious) return place - 1;
  return turns.empty() ? place : turns[static_cast<std::size_t>(place)];
}

int place_after(int place, std::uint8_t action, const std::vector<int>& turns, int times, int places) {
  for (int i = 0; i < times; ++i) {
    const int next = place_after(place, action, turns);
    if (next < 0 || next >= places) break;
    place = next;
  }
  return place;
}

void distances_to(int goal, int places, const std::vector<int>& turns, std::vector<int>& distances) {
  std::vector<int> turned_from(turns.size());
  for (std::size_t place = 0; place < turns.size(); ++place)
    turned_from[static_cast<std::size_t>(turns[place])] = static_cast<int>(place);
  distances.assign(static_cast<std::size_t>(places), -1);
  std::vector<int> reached = {goal};
  reached.reserve(static_cast<std::size_t>(places));
  distances[static_cast<std::size_t>(goal)] = 0;
  for (std::size_t i = 0; i < reached.size(); ++i) {
    const int place = reached[i];
    const auto reach = [&](int from) {
      if (from < 0 || from >= places || distances[static_cast<std::size_t>(from)] >= 0) return;
      distances[static_cast<std::size_t>(from)] = distances[static_cast<std::size_t>(place)] + 1;
      reached.push_back(from);
    };
    reach(place - 1);
    reach(place + 1);
    if (!turns.empty()) reach(turned_from[static_cast<std::size_t>(place)]);
  }
}

}  // namespace citylearn
