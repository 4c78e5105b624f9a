// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cmath>

#include "core/plugin/registry.h"
#include "core/task/action.h"
#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// What is less likely than this is never the case. Logarithms of floats reach a little further.
constexpr float kNegligible = 1e-30f;
/// Probability, a step, of a kidnapping that an agent reckons with at least where it learns how often actions slip.
/// Without it nothing would be believed after a leap that is impossible.
constexpr double kLeastKidnap = 1e-6;
/// Parameter of networks with a Motion, its TemperingLimit; 0 where a checkpoint does not say it.
constexpr const char* kSlipsLimitTempering = "slips-limit-tempering";

/// Which mishaps bound how far evidence is tempered, see Motion::later(). Checkpoints of before have the first two.
enum class TemperingLimit { kKidnappings, kAnyMishap, kHalfBetweenMishaps };

/// Moves a belief b over the N places of a route by an action, in a world that may be imperfect
/// (docs/how-to/try-an-imperfect-world.md). A is the action's transition matrix in a perfect world:
///   (1 - k) ((1 - p) A b + p / 2 (b + A A b)) + k / N,
/// p = `slip`, k = `kidnap`. A drops what would leave the route, because such actions are masked. In A A, the second
/// step has no effect at the end of the route.
template <class S>
class Motion {
 public:
  static std::vector<ParameterSpec> parameters() {
    return {{"slip", "probability that an action slips: half of these do nothing, half are done twice", 0, 0, 1},
            {"kidnap", "probability, a step, of being carried anywhere", 0, 0, 1}};
  }

  Motion(double slip, double kidnap, TemperingLimit limit = TemperingLimit::kHalfBetweenMishaps)
      : slip_(static_cast<S>(slip)), kidnap_(static_cast<S>(kidnap)), limit_(limit) {}

  /// Returns whether the world is perfect: p = k = 0.
  bool exact() const { return slip_ == 0 && kidnap_ == 0; }
  void set(S slip, S kidnap) {
    slip_ = slip;
    kidnap_ = kidnap;
  }
  S slip() const { return slip_; }
  S kidnap() const { return kidnap_; }
  TemperingLimit limit() const { return limit_; }
  /// Returns t, by which evidence is tempered, one step later: steps since the episode's start in a perfect world. Else
  /// what was seen before a slip says less of the place after it, and what was seen before a kidnapping nothing: what
  /// still counts is at most 1 / (p + sqrt(k)) steps old, half of that on average, below which t stays.
  S later(S t) const {
    const S by_kidnap = kidnap_ > S(kLeastKidnap) ? std::sqrt(kidnap_) : S(0);
    if (limit_ == TemperingLimit::kHalfBetweenMishaps) return (t + 1) / (1 + 2 * (slip_ + by_kidnap));
    return (t + 1) * (1 - (limit_ == TemperingLimit::kAnyMishap ? std::max(slip_, by_kidnap) : by_kidnap));
  }

  /// to = A from, with `nothing` at the place that nothing moves to.
  template <class From, class To>
  void shift(std::uint8_t action, const From& from, To&& to, S nothing = 0) const {
    const std::ptrdiff_t n = from.size() - 1;
    if (action == kNext) {
      to.tail(n) = from.head(n);
      to(0) = nothing;
    } else if (action == kPrevious) {
      to.head(n) = from.tail(n);
      to(n) = nothing;
    } else {
      to = from;
    }
  }
  /// Moves a belief, which sums to 1.
  template <class From, class To>
  void move(std::uint8_t action, const From& from, To&& to) {
    once_.resize(from.size());
    twice_.resize(from.size());
    shift(action, from, once_);
    shift(action, once_, twice_);
    if (const std::ptrdiff_t end = end_of(action, from.size()); end >= 0) twice_(end) += once_(end);
    to = (1 - kidnap_) * ((1 - slip_) * once_ + slip_ / 2 * (from + twice_));
    to.array() += kidnap_ / static_cast<S>(from.size());
  }
  /// Moves scores, whose softmax is the belief. Places of probability 0 get `never`.
  template <class From, class To>
  void move_scores(std::uint8_t action, const From& from, To&& to, S never) {
    if (exact()) return shift(action, from, to, never);
    odds_ = (from.array() - from.maxCoeff()).exp();
    odds_ /= odds_.sum();
    move_belief(action, odds_, to, never);
  }
  /// Does the same for the belief itself, where the motion is not exact().
  template <class From, class To>
  void move_belief(std::uint8_t action, const From& from, To&& to, S never) {
    moved_.resize(from.size());
    move(action, from, moved_);
    to = moved_.array().max(S(kNegligible)).log();  // apart: within select() Eigen takes one logarithm after another
    to = (moved_.array() > S(kNegligible)).select(to, never);
  }

 private:
  /// Returns the place at which a second step has no effect; -1: none.
  static std::ptrdiff_t end_of(std::uint8_t action, std::ptrdiff_t places) {
    return action == kNext ? places - 1 : action == kPrevious ? 0 : -1;
  }

  S slip_, kidnap_;
  TemperingLimit limit_;
  Vector<S> once_, twice_, odds_, moved_;
};

}  // namespace citylearn
