// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace citylearn {

/// Probability of being lost above which an agent says so.
constexpr double kMaxLost = 0.7;

/// Decides whether an agent says that it is lost, by its beliefs (msg::Belief) from step to step. It says so while it
/// is lost again, and where its likeliest place leaps to one that was not likely when it was surest of where it was: an
/// agent that was carried away doubts for some steps, then leaps to where it is. One that begins an episode, or leaps
/// to a place that it had reckoned with, is only finding itself.
class LostWatch {
 public:
  /// Begins an episode.
  void reset() {
    forget();
    found_ = false;
  }
  /// Forgets what was believed: no place of the next step counts as a leap.
  void forget() { places_.clear(); }
  /// Returns the likeliest place of the last belief.
  std::uint32_t likeliest() const { return likeliest_; }

  /// Takes in the belief after a step: its `places`, the likeliest first, their probabilities, and the probability of
  /// being lost. Returns whether the agent says that it is lost, above `bound` or by a leap.
  bool says_lost(std::span<const std::uint32_t> places, std::span<const float> probabilities, double lost,
                 double bound) {
    const bool begins = places_.empty(), leaps = !begins && apart(likeliest_, places.front()) > kReach;
    likeliest_ = places.front();
    ++steps_;
    const bool says = (found_ && lost > bound) || (leaps && least_lost_ <= bound && expected() < kMaxExpected);
    found_ = found_ || lost <= bound;
    if (begins || leaps || lost <= least_lost_) {
      least_lost_ = lost;
      steps_ = 0;
      places_.assign(places.begin(), places.end());
      probabilities_.assign(probabilities.begin(), probabilities.end());
    }
    return says;
  }

 private:
  static constexpr std::uint32_t kReach = 3;  // two places by a slip, and one within which a belief is right
  static constexpr double kMaxExpected = 0.1;

  static std::uint32_t apart(std::uint32_t a, std::uint32_t b) { return a > b ? a - b : b - a; }
  /// Returns how likely it was, when the agent was surest, that it stood elsewhere and from there came to where it is.
  double expected() const {
    double sum = 0;
    for (std::size_t i = 0; i < places_.size(); ++i)
      if (apart(places_[i], places_.front()) > kReach && apart(places_[i], likeliest_) <= 2 * steps_ + 1)
        sum += static_cast<double>(probabilities_[i]);
    return sum;
  }

  bool found_ = false;                       // at some step of the episode the agent was not lost
  std::uint32_t likeliest_ = 0, steps_ = 0;  // of the last belief; since the surest one
  // The belief when the agent was surest, since its likeliest place leapt. No places: forgotten.
  double least_lost_ = 1;
  std::vector<std::uint32_t> places_;
  std::vector<float> probabilities_;
};

}  // namespace citylearn
