// SPDX-License-Identifier: Apache-2.0
#include "sparse_filter.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

#include "policy_service/network/agent_network.h"

namespace citylearn {
namespace {

template <class S>
auto array_of(std::vector<S>& values) {
  return Eigen::Map<Eigen::Array<S, Eigen::Dynamic, 1>>(values.data(), static_cast<std::ptrdiff_t>(values.size()));
}
template <class S>
auto array_of(const std::vector<S>& values) {
  return Eigen::Map<const Eigen::Array<S, Eigen::Dynamic, 1>>(values.data(),
                                                              static_cast<std::ptrdiff_t>(values.size()));
}

/// Calls visit(to, share) with each state to which an action leads from one, unless the agent is kidnapped.
template <class S, class Visit>
void spread(const Motion<S>& motion, const StateMap& map, std::uint8_t action, int state, Visit&& visit) {
  const auto after = [&](int from) { return action < kActions ? map.next(from, action) : from; };
  const int once = after(state);
  if (motion.slip() > 0) visit(state, motion.slip() / 2);
  if (once < 0) return;
  visit(once, 1 - motion.slip());
  if (motion.slip() == 0) return;
  const int twice = after(once);
  visit(twice >= 0 ? twice : once, motion.slip() / 2);
}

enum { kElsewhere, kSteps, kDoubt, kGoal, kCount, kFirstPlace };  // of a state
constexpr float kNothing = -1e5f;                                 // score of what is impossible

}  // namespace

template <class S>
void SparseBelief<S>::store(Eigen::Ref<Vector<S>> state) const {
  const auto count = static_cast<std::ptrdiff_t>(places.size());
  state.setZero();
  state.template head<kFirstPlace>() << elsewhere, steps, doubt, static_cast<S>(goal + 1), static_cast<S>(count);
  for (std::ptrdiff_t i = 0; i < count; ++i) {
    state(kFirstPlace + i) = static_cast<S>(places[static_cast<std::size_t>(i)]);
    state(kFirstPlace + kMaxActive + i) = shares[static_cast<std::size_t>(i)];
  }
}

template <class S>
void SparseBelief<S>::load(const Eigen::Ref<const Vector<S>>& state, int frames) {
  const auto within = [](S value, S most) { return value > 0 ? std::min(value, most) : S(0); };
  elsewhere = within(state(kElsewhere), 1);
  steps = within(state(kSteps), S(1e9));
  doubt = within(state(kDoubt), S(1e9));
  goal = static_cast<int>(within(state(kGoal), static_cast<S>(frames))) - 1;
  places.clear();
  shares.clear();
  const int count = static_cast<int>(within(state(kCount), kMaxActive));
  for (int i = 0; i < count; ++i) {
    places.push_back(static_cast<int>(within(state(kFirstPlace + i), static_cast<S>(frames - 1))));
    shares.push_back(within(state(kFirstPlace + kMaxActive + i), 1));
  }
}

template <class S>
Vector<S> SparseBelief<S>::scores(int frames) const {
  const auto others = std::max<std::ptrdiff_t>(1, frames - static_cast<std::ptrdiff_t>(places.size()));
  const auto score = [](S share) { return share > S(kNegligible) ? std::log(share) : S(kNothing); };
  Vector<S> scores = Vector<S>::Constant(frames, score(elsewhere / static_cast<S>(others)));
  for (std::size_t i = 0; i < places.size(); ++i) scores(places[i]) = score(shares[i]);
  return scores;
}

template <class S>
void SparseFilter<S>::advance(const Matrix<S>& features, int frames, S evidence, S tempering,
                              std::span<SparseStep<S>> steps) {
  if (frames != frames_) {
    probes_ = keys_.sample(frames, kProbes);
    slots_.assign(static_cast<std::size_t>(frames), -1);
    if (!map_ || map_->line()) map_ = std::make_shared<const StateMap>(frames);
    frames_ = frames;
  }
  seen_.resize(features.rows(), static_cast<std::ptrdiff_t>(steps.size()));
  looking_.clear();
  for (std::size_t i = 0; i < steps.size(); ++i) {
    seen_.col(static_cast<std::ptrdiff_t>(i)) = features.col(steps[i].seen);
    const SparseStep<S>& step = steps[i];
    if (looks(step)) looking_.push_back(static_cast<int>(i));
  }
  probes_.look(seen_, kProbes, block_, probed_);
  if (!looking_.empty()) {
    looked_ = seen_(Eigen::all, looking_);
    keys_.look(looked_, frames, block_, wide_);
  }
  std::ptrdiff_t wide = 0;
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const auto column = static_cast<std::ptrdiff_t>(i);
    SparseStep<S>& step = steps[i];
    const bool looks =
        wide < static_cast<std::ptrdiff_t>(looking_.size()) && looking_[static_cast<std::size_t>(wide)] == column;
    move(step, frames, looks);
    if (looks) {
      step.similarity.assign(wide_.col(wide).begin(), wide_.col(wide).end());
      ++wide;
    } else if (step.repeated) {
      step.similarity.assign(step.places.size(), 0);
    } else {
      step.similarity.clear();
      for (const int place : step.places) step.similarity.push_back(keys_.similarity(place, seen_.col(column), key_));
    }
    exclude(step, frames, column);
    see(step, frames, column, evidence / (1 + tempering * step.after.steps));
    if (looks) step.after.doubt = 0;
    keep_active(step);
  }
}

/// Moves the belief by the action before the step.
template <class S>
void SparseFilter<S>::move(SparseStep<S>& step, int frames, bool everywhere) {
  const S kidnap = motion_.kidnap();
  const S kept = step.first ? S(0) : lost(step) ? S(0.5) : S(1);  // of the belief before
  step.places.clear();
  step.prior.clear();
  if (!step.first)
    for (std::size_t i = 0; i < step.before->places.size(); ++i)
      spread(motion_, *map_, step.action, step.before->places[i], [&](int to, S share) {
        int& slot = slots_[static_cast<std::size_t>(to)];
        if (slot < 0) {
          slot = static_cast<int>(step.places.size());
          step.places.push_back(to);
          step.prior.push_back(0);
        }
        step.prior[static_cast<std::size_t>(slot)] += (1 - kidnap) * kept * share * step.before->shares[i];
      });
  for (const int place : step.places) slots_[static_cast<std::size_t>(place)] = -1;
  const S elsewhere = step.first ? S(1) : 1 - kept + kept * step.before->elsewhere;
  step.even = ((1 - kidnap) * elsewhere + kidnap) / static_cast<S>(frames);
  step.after.steps = kept < 1 ? S(0) : motion_.later(step.before->steps);
  step.after.doubt = step.first ? S(0) : step.before->doubt;
  step.after.goal = step.goal;
  array_of(step.prior) += step.even;
  if (step.arrived()) arrive(step);
  if (!everywhere) return;
  moved_.setConstant(frames, step.even);
  for (std::size_t i = 0; i < step.places.size(); ++i) moved_(step.places[i]) = step.prior[i];
  step.prior.assign(moved_.begin(), moved_.end());
  step.places.resize(static_cast<std::size_t>(frames));
  std::iota(step.places.begin(), step.places.end(), 0);
}

/// Excludes all but the goal that the agent has reached. What was believed tells the heading with which it came.
template <class S>
void SparseFilter<S>::arrive(SparseStep<S>& step) {
  std::vector<int> goal{step.before->goal};
  if (!map_->line()) goal = map_->places_around(std::min(goal.front(), map_->places() - 1), goal_radius_);
  const auto at_goal = [&](int state) { return std::find(goal.begin(), goal.end(), map_->place(state)) != goal.end(); };
  bool believed = false;
  for (std::size_t i = 0; i < step.places.size(); ++i) {
    if (!at_goal(step.places[i])) step.prior[i] = 0;
    believed = believed || step.prior[i] > 0;
  }
  step.even = step.after.doubt = 0;
  if (believed) return;
  step.places.clear();
  for (int state = 0; state < map_->states(); ++state)
    if (at_goal(state)) step.places.push_back(state);
  step.prior.assign(step.places.size(), 1);
  step.after.steps = 0;
}

/// Excludes where the agent cannot be, as exclude() does. On streets these are the states of the goal, and those where
/// other actions are allowed.
template <class S>
void SparseFilter<S>::exclude(SparseStep<S>& step, int frames, std::ptrdiff_t column) {
  if (!map_->line()) {
    for (std::size_t i = 0; i < step.places.size(); ++i)
      if (const int state = step.places[i]; map_->place(state) == step.goal || map_->allowed(state) != step.allowed)
        step.prior[i] = 0;
    return;
  }
  const bool starts = !(step.allowed >> kPrevious & 1), ends = !(step.allowed >> kNext & 1);
  if (starts || ends) {
    const int place = starts ? 0 : frames - 1;
    step.places.assign(1, place);
    step.prior.assign(1, 1);
    step.similarity.assign(1, keys_.similarity(place, seen_.col(column), key_));
    step.even = 0;
    return;
  }
  for (std::size_t i = 0; i < step.places.size(); ++i)
    if (const int place = step.places[i]; place == step.goal || place == 0 || place == frames - 1) step.prior[i] = 0;
}

template <class S>
void SparseFilter<S>::see(SparseStep<S>& step, int frames, std::ptrdiff_t column, S weight) {
  if (step.repeated) weight = 0;
  const auto probes = probed_.col(column).array();
  const auto similarity = array_of(step.similarity);
  const S top = std::max(probes.maxCoeff(), similarity.size() > 0 ? similarity.maxCoeff() : S(-1));
  step.shares.resize(step.places.size());
  auto shares = array_of(step.shares);
  shares = array_of(step.prior) * (weight * (similarity - top)).exp();
  const Vector<S> others = (weight * (probes - top)).exp();
  step.elsewhere = step.even * static_cast<S>(frames - shares.size()) * others.mean();
  const S active = shares.sum(), total = active + step.elsewhere;
  if (active > 0 && !step.repeated) {
    const S looks = (shares * similarity).sum() / active;
    const S share = static_cast<S>((probes >= looks).count()) / static_cast<S>(kProbes);
    step.after.doubt = std::max(S(0), step.after.doubt + share - kUsualShare);
  }
  if (total > 0) {
    shares /= total;
    step.elsewhere /= total;
  } else {  // nothing that is possible was believed
    shares.setZero();
    step.elsewhere = 1;
  }
}

template <class S>
void SparseFilter<S>::keep_active(SparseStep<S>& step) const {
  SparseBelief<S>& after = step.after;
  after.elsewhere = step.elsewhere;
  step.active.clear();
  for (std::size_t i = 0; i < step.shares.size(); ++i) {
    if (step.shares[i] >= kLeast)
      step.active.push_back(static_cast<int>(i));
    else
      after.elsewhere += step.shares[i];
  }
  const auto share = [&](int i) { return step.shares[static_cast<std::size_t>(i)]; };
  if (step.active.size() > most_active_) {
    const auto end = step.active.begin() + static_cast<std::ptrdiff_t>(most_active_);
    std::nth_element(step.active.begin(), end, step.active.end(),
                     [&](int a, int b) { return share(a) != share(b) ? share(a) > share(b) : a < b; });
    for (auto dropped = end; dropped != step.active.end(); ++dropped) after.elsewhere += share(*dropped);
    step.active.erase(end, step.active.end());
  }
  after.places.clear();
  after.shares.clear();
  for (const int i : step.active) {
    after.places.push_back(step.places[static_cast<std::size_t>(i)]);
    after.shares.push_back(share(i));
  }
}

template struct SparseBelief<NetworkScalar>;
template class SparseFilter<NetworkScalar>;

}  // namespace citylearn
