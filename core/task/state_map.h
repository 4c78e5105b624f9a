// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>
#include <list>
#include <memory>
#include <utility>
#include <vector>

#include "core/task/action.h"
#include "core/task/street_map.h"

namespace citylearn {

/// Which states a map has, and where actions lead.
enum class StateRule : std::uint8_t {
  kLine,         ///< places in a row, a state each; stay, next, previous
  kStreet,       ///< the link that one faces (as in Touchdown): forward goes along it, left and right turn to the next
  kStreetFixed,  ///< 16 headings at each place: forward goes along the nearest link within 30 degrees
  kStreetLearn,  ///< likewise, but forward goes to the nearest place within three links and 30 degrees (StreetLearn)
};

/// Actions on streets. A route has kStay, kNext and kPrevious instead.
enum : std::uint8_t { kLeft = 0, kForward = 1, kRight = 2 };

/// The states in which an agent can be, and where each action leads. On a line they are its places; on streets, places
/// with a heading. A goal is a place: it is reached in each of its states. Never changes.
class StateMap {
 public:
  static constexpr int kHeadings = 16;  ///< of a place, where they are fixed; the first looks north

  /// A line of so many places.
  explicit StateMap(int places) : places_(places), states_(places) {}
  /// Streets, which must be in order. Throws Error where they have more than `most` states.
  StateMap(const StreetMap& streets, StateRule rule, std::size_t most);

  int states() const { return states_; }
  int places() const { return places_; }
  bool line() const { return next_.empty(); }
  int place(int state) const { return line() ? state : place_[static_cast<std::size_t>(state)]; }
  /// Returns where an action leads, or -1 where it is not allowed.
  int next(int state, std::uint8_t action) const {
    if (!line()) return next_[static_cast<std::size_t>(state)][action];
    const int to = action == kNext ? state + 1 : action == kPrevious ? state - 1 : state;
    return to < places_ ? to : -1;
  }
  /// Returns where an action leads that is done `times` times. What is not allowed comes to nothing.
  int after(int state, std::uint8_t action, int times) const;
  /// Returns bit a set where action a is allowed.
  std::uint8_t allowed(int state) const;
  /// Returns the heading that a state of streets looks to, degrees clockwise from north.
  float heading(int state) const { return heading_[static_cast<std::size_t>(state)]; }
  /// Returns the states in which an episode may begin on streets: those of a place that can be left; under kStreetLearn
  /// those that look north.
  const std::vector<int>& starts() const { return starts_; }
  /// Returns the states from which an action leads to `state`.
  std::pair<const int*, const int*> before(int state) const {
    const auto at = static_cast<std::size_t>(state);
    return {before_.data() + first_before_[at], before_.data() + first_before_[at + 1]};
  }
  /// Returns the fewest steps from each state of streets to the nearest of the goals, which are places. `on`: of each
  /// state, steps that follow where one arrives at a goal in it, and count too. kNoWay: none of the goals is reached.
  std::vector<std::uint16_t> steps_to(const std::vector<int>& goals, const std::vector<std::uint16_t>& on = {}) const;
  /// Returns the places at most `radius` metres from one, itself first.
  std::vector<int> places_around(int place, float radius) const;

  static constexpr std::uint16_t kNoWay = 65535;

 private:
  void add_link_headings(const StreetMap& streets);
  void add_fixed_headings(const StreetMap& streets, bool by_place);
  void add_predecessors();

  int places_, states_;
  std::vector<int> place_, starts_;              ///< S
  std::vector<std::array<int, kActions>> next_;  ///< S; empty: a line
  std::vector<float> heading_;                   ///< S
  std::vector<int> first_before_, before_;       ///< S + 1; predecessors of each state
  std::vector<int> first_state_;                 ///< P + 1; the states of a place stand together
  std::vector<float> east_, north_;              ///< P, metres
};

/// The fewest steps from each state to a goal.
class DistanceField {
 public:
  DistanceField() = default;  ///< to place 0 of a line
  explicit DistanceField(int goal) : goal_(goal) {}
  explicit DistanceField(std::shared_ptr<const std::vector<std::uint16_t>> steps) : steps_(std::move(steps)) {}

  bool reaches(int state) const { return !steps_ || (*this)(state) != StateMap::kNoWay; }
  int operator()(int state) const {
    return steps_ ? (*steps_)[static_cast<std::size_t>(state)] : std::abs(goal_ - state);
  }

 private:
  int goal_ = 0;
  std::shared_ptr<const std::vector<std::uint16_t>> steps_;  ///< null: on a line
};

/// Makes distance fields where they are needed and keeps the newest. Used by one thread.
class DistanceFields {
 public:
  /// `map` must outlive it. A goal is also reached at places within `radius` metres of it.
  explicit DistanceFields(const StateMap& map, float radius = 0, std::size_t kept = 64)
      : map_(map), radius_(radius), kept_(kept) {}
  DistanceField to(int goal);

 private:
  using Kept = std::pair<int, std::shared_ptr<const std::vector<std::uint16_t>>>;

  const StateMap& map_;
  float radius_;
  std::size_t kept_;
  std::list<Kept> fields_;  ///< the one used last stands first
};

}  // namespace citylearn
