// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "core/task/state_map.h"
#include "motion.h"
#include "place_keys.h"

namespace citylearn {

/// What an agent on a long route, or on streets, believes. Active places have a probability of their own. All others of
/// the route's N places share the rest evenly. On streets these are states.
template <class S>
struct SparseBelief {
  static constexpr int kMaxActive = 1024, kStateSize = 5 + 2 * kMaxActive;

  std::vector<int> places;  ///< active ones, in no order
  std::vector<S> shares;    ///< probability of each
  S elsewhere = 1;          ///< probability of all other places together
  S steps = 0;              ///< since the episode's start, or since the agent was lost, as Motion counts them
  S doubt = 0;              ///< see SparseFilter
  int goal = -1;            ///< to which the agent goes; -1: unknown

  /// Writes it to kStateSize numbers.
  void store(Eigen::Ref<Vector<S>> state) const;
  /// Reads what store() wrote. Other numbers give some belief over the first `frames` places.
  void load(const Eigen::Ref<const Vector<S>>& state, int frames);
  /// Returns scores of N places; their softmax is the belief.
  Vector<S> scores(int frames) const;
};

/// A step of one agent: what happened, and what it believes then.
template <class S>
struct SparseStep {
  const SparseBelief<S>* before = nullptr;  ///< not looked at where `first`
  int seen = 0;                             ///< column of the features
  int goal = 0;
  std::uint8_t action = 0, allowed = 0;  ///< the action that led here, and those allowed here
  bool first = false;                    ///< an episode's first observation
  bool repeated = false;                 ///< the agent saw the same earlier in the episode: it counts no more

  /// Returns whether the action reached the goal that the agent had before.
  bool arrived() const { return !first && before->goal >= 0 && before->goal != goal; }

  std::vector<int> places;  ///< where the agent may be: what was active and where that leads, or all places
  std::vector<S> shares;    ///< belief in each
  S elsewhere = 0;          ///< belief in all others together
  SparseBelief<S> after;    ///< without the places that do not matter

  std::vector<S> prior, similarity;  ///< of `places`: belief before anything was seen; how much each looks like it
  S even = 0;                        ///< prior of each other place
  std::vector<int> active;           ///< indices of the active among `places`
};

/// A Bayes filter over a long route, as place_filter.cc describes it, or over the states of streets, that looks at few
/// places. All are looked at when an episode begins, when much of the belief is elsewhere, and when the agent is lost.
/// Otherwise the evidence for all other places together is the mean of that for kProbes of them.
///
/// An agent is lost when its doubt exceeds kMaxDoubt. Doubt is a cumulative sum (Page, 1954) of the share of probes
/// that look at least as much like what is seen as the places believed in, less kUsualShare. Where the agent is right
/// that share is near 0, and where it is lost 1/2 on average, whatever the features are. A lost agent gives up half of
/// its belief, and its evidence counts again as at an episode's start. An agent that has reached a goal, and got the
/// next one, is where that goal was. Used by one thread.
template <class S>
class SparseFilter {
 public:
  /// `keys` are compact and outlive it. Without `streets` places are those of a line; on streets a goal is also reached
  /// within `goal_radius` metres of it. At most `most_active` states are active after a step.
  SparseFilter(const PlaceKeys<S>& keys, const Motion<S>& motion, std::shared_ptr<const StateMap> streets = {},
               float goal_radius = 0, std::size_t most_active = SparseBelief<S>::kMaxActive)
      : keys_(keys), motion_(motion), map_(std::move(streets)), goal_radius_(goal_radius), most_active_(most_active) {}

  void set_motion(S slip, S kidnap) { motion_.set(slip, kidnap); }
  /// Fills the steps of several agents, on the route's first `frames` places (on streets all). What is seen weighs
  /// exp(evidence / (1 + tempering * steps) * similarity).
  void advance(const Matrix<S>& features, int frames, S evidence, S tempering, std::span<SparseStep<S>> steps);

 private:
  static constexpr std::ptrdiff_t kProbes = 64;
  static constexpr S kLeast = S(1e-6), kUsualShare = S(0.15), kMaxDoubt = 1;

  static bool lost(const SparseStep<S>& step) {
    return step.before->doubt > kMaxDoubt && !step.repeated && !step.arrived();
  }
  static bool looks(const SparseStep<S>& step) {
    constexpr S kBeginning = 4;  // steps
    const S most = S(step.first || step.before->steps < kBeginning ? 0.01 : 0.5);
    return step.first || lost(step) || (step.before->elsewhere > most && !step.repeated && !step.arrived());
  }
  void move(SparseStep<S>& step, int frames, bool everywhere);
  void arrive(SparseStep<S>& step);
  void exclude(SparseStep<S>& step, int frames, std::ptrdiff_t column);
  void see(SparseStep<S>& step, int frames, std::ptrdiff_t column, S weight);
  void keep_active(SparseStep<S>& step) const;

  const PlaceKeys<S>& keys_;
  Motion<S> motion_;
  std::shared_ptr<const StateMap> map_;  // of streets, or of a line of frames_ places
  float goal_radius_;
  std::size_t most_active_;
  PlaceKeys<S> probes_;
  int frames_ = 0;                                   // among which the probes are
  std::vector<int> slots_, looking_;                 // N, -1 or index among a step's places; steps that look at all
  Matrix<S> seen_, looked_, probed_, wide_, block_;  // D x steps, D x looking; probes x steps, N x looking
  Vector<S> key_, moved_, by_prior_;
};

}  // namespace citylearn
