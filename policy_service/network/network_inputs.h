// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/task/state_map.h"

namespace citylearn {

template <class S>
using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;  // column-major: a column is a sample
template <class S>
using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

/// From so many places on, beliefs over them are sparse (docs/decisions/0025-sparse-beliefs.md).
constexpr int kSparsePlaces = 2048;

/// The task that a network is built for.
struct NetworkTask {
  int features = 0;  ///< D
  int frames = 128;  ///< N, places on the route; on streets their states
  /// D x EN, features of the route as each of E training traversals shows it, the experiences side by side: the place
  /// memory of networks that have one.
  Matrix<float> reference;
  int sparse_from = kSparsePlaces;               ///< from so many places on, beliefs over them are sparse
  std::shared_ptr<const StateMap> streets = {};  ///< null: a line of N places
  float goal_radius = 0;                         ///< metres; on streets a goal is also reached at places within it
  int goals = 0;                                 ///< places of streets whose map is not here; 0: a line

  /// Returns the number of experiences, E; 1 where there is no reference.
  int experiences() const { return std::max(1, static_cast<int>(reference.cols()) / frames); }
  /// Returns the number of places, which goals are.
  int places() const { return streets ? streets->places() : goals > 0 ? goals : frames; }
  /// Returns where actions lead.
  std::shared_ptr<const StateMap> map() const { return streets ? streets : std::make_shared<const StateMap>(frames); }
};

/// Observations of B agents over T steps; column t * B + b is agent b at step t.
template <class S>
struct NetworkInputs {
  int steps = 0;          ///< T
  int agents = 0;         ///< B
  int frames = 0;         ///< places in use, <= N; fewer in a curriculum's early lessons
  int distinct = 0;       ///< U, number of distinct feature vectors
  Matrix<S> features;     ///< D x at least U: each distinct feature vector stands here once
  std::vector<int> seen;  ///< TB, column of `features`
  /// TB, place whose frame it is, plus `frames` times its experience; -1: augmented, on streets -2 less that place.
  std::vector<int> shown;
  std::vector<int> goal;      ///< TB, place on the route, 0..N-1; on streets the place
  std::vector<int> position;  ///< TB, place on the route (on streets the state): the baseline sees it, losses aim at it
  std::vector<std::uint8_t> previous_action;  ///< TB, kNoAction at an episode's start
  std::vector<std::uint8_t> allowed;          ///< TB, bit a = action a allowed
  std::vector<std::uint8_t> first;            ///< TB, 1 = first observation of an episode: the state before it is wiped

  /// Empties all columns and keeps their memory.
  void resize(int feature_dimension, int step_count, int agent_count);
  /// Sets the D features of `column`; once for each column. The same `place` (unless -1) means the same numbers.
  void see(std::ptrdiff_t column, int place, const Eigen::Ref<const Vector<S>>& numbers);
  /// Copies column `from` of `source` to the empty column `to`.
  void copy_column(const NetworkInputs& source, std::ptrdiff_t from, std::ptrdiff_t to);
  /// Returns the features of `column`.
  auto features_of(std::ptrdiff_t column) const { return features.col(seen[static_cast<std::size_t>(column)]); }
  /// Returns the number of the view that `column` shows on streets, augmented or not; -1: unknown.
  int view(std::size_t column) const { return shown[column] >= 0 ? shown[column] % frames : augmented(shown[column]); }
  /// Returns what `shown` is of a view whose features are the agent's own, as augmented ones are.
  static int own(const NetworkTask& task, std::int64_t view) {
    return task.streets ? augmented(static_cast<int>(view)) : -1;
  }
  auto features_of(std::ptrdiff_t column) { return features.col(seen[static_cast<std::size_t>(column)]); }

 private:
  static int augmented(int view) { return view == -1 ? -1 : -2 - view; }  // and the other way round

  std::vector<int> column_of_;  ///< by place, column of `features`; -1 where the place was not seen
};

/// One named tensor within the flat vector of parameters, column-major.
struct Tensor {
  std::string name;
  std::ptrdiff_t rows = 0, cols = 0, offset = 0;
};

/// A network's outputs for each observation, or a loss's derivatives by them.
template <class S>
struct Heads {
  Matrix<S> logits;  ///< 3 x TB, masked actions at -1e9
  Matrix<S> values;  ///< 1 x TB
  /// 2 x TB: estimates of auxiliary_targets(), read off the recurrent state. Only a training loss uses them; 0 x 0
  /// where the network has no such head or it was not asked for.
  Matrix<S> auxiliary;
};

/// Returns what `Heads::auxiliary` should be for an agent at `position` with this goal, on a route of N places:
/// 4 (position / N - 1/2) and 2 tanh((goal - position) / 8). Scalars, so that a linear policy can read them off the
/// state.
template <class S>
std::array<S, 2> auxiliary_targets(int position, int goal, int frames) {
  return {S(4) * (static_cast<S>(position) / static_cast<S>(frames) - S(0.5)),
          S(2) * std::tanh(static_cast<S>(goal - position) / S(8))};
}

}  // namespace citylearn
