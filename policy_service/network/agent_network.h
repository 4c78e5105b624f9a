// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/util/random.h"
#include "core/plugin/registry.h"

namespace citylearn {

template <class S>
using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;  // column-major: a column is a sample
template <class S>
using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

/// What a network is built for.
struct NetworkTask {
  int features = 0;  ///< D
  int frames = 128;  ///< N, places on the route
  Matrix<float>
      reference;  ///< D x N, features of the training traversal's route: the place memory of networks that have one
  std::vector<int> turns =
      {};  ///< N, where `stay` leads (core/task/route_map.h), for networks that know the map; empty: a line
};

/// Observations of B agents over T steps; column t * B + b is agent b at step t.
template <class S>
struct NetworkInputs {
  int steps = 0;              ///< T
  int agents = 0;             ///< B
  int frames = 0;             ///< places in use, <= N; fewer in a curriculum's early lessons
  int distinct = 0;           ///< U, different things seen
  Matrix<S> features;         ///< D x at least U: each thing seen stands here once, and is worked on once
  std::vector<int> seen;      ///< TB, column of `features`
  std::vector<int> shown;     ///< TB, place whose frame it is, 0..N-1; -1: a thing of its own (a disguised frame)
  std::vector<int> goal;      ///< TB, place on the route, 0..N-1
  std::vector<int> position;  ///< TB, place on the route: what the baseline sees, and a target of losses
  std::vector<std::uint8_t> previous_action;  ///< TB, kNoAction at an episode's start
  std::vector<std::uint8_t> allowed;          ///< TB, bit a = action a allowed
  std::vector<std::uint8_t> first;            ///< TB, 1 = first observation of an episode: the state before it is wiped

  /// Nothing is seen yet. Keeps the room it has.
  void resize(int feature_dimension, int step_count, int agent_count);
  /// What `column` sees, D numbers; once for each column. The same `place` (unless -1) means the same numbers.
  void see(std::ptrdiff_t column, int place, const Eigen::Ref<const Vector<S>>& numbers);
  /// Copies column `from` of `source` to column `to`, which has seen nothing yet.
  void copy_column(const NetworkInputs& source, std::ptrdiff_t from, std::ptrdiff_t to);
  /// What `column` sees.
  auto features_of(std::ptrdiff_t column) const { return features.col(seen[static_cast<std::size_t>(column)]); }
  auto features_of(std::ptrdiff_t column) { return features.col(seen[static_cast<std::size_t>(column)]); }

 private:
  std::vector<int> column_of_;  ///< by place, column of `features`; -1: not seen
};

/// One named tensor within the flat vector of parameters, column-major.
struct Tensor {
  std::string name;
  std::ptrdiff_t rows = 0, cols = 0, offset = 0;
};

/// What a network says of each observation, or a loss's derivatives by it.
template <class S>
struct Heads {
  Matrix<S> logits;  ///< 3 x TB, masked actions at -1e9
  Matrix<S> values;  ///< 1 x TB
  /// 2 x TB: the place stood at and the way to the goal (see whereabouts()), as told from the recurrent state. A
  /// training loss alone looks at it; 0 x 0 where there is no such head or it was not asked for.
  Matrix<S> whereabouts;
};

/// What `Heads::whereabouts` should say of an agent at `position` with this goal, on a route of N places: 4 (position /
/// N - 1/2) and 2 tanh((goal - position) / 8). Scalars, so that a linear policy can read them off the state.
template <class S>
std::array<S, 2> whereabouts(int position, int goal, int frames) {
  return {S(4) * (static_cast<S>(position) / static_cast<S>(frames) - S(0.5)),
          S(2) * std::tanh(static_cast<S>(goal - position) / S(8))};
}

/// Results of a forward pass, and whatever the network keeps for the backward pass. Used again and again: no allocation
/// while the sizes stay the same.
template <class S>
struct Workspace {
  virtual ~Workspace() = default;
  bool localise = false;  ///< asks for `heads.whereabouts`; only a training loss does
  /// Not 0: no backward pass follows, and as long as this number stays the same, so do the parameters: a network may
  /// keep what it made of a thing it has seen.
  std::uint64_t fixed = 0;
  Heads<S> heads;
  Matrix<S> state;  ///< state_size x B, after the last step
};

/// An agent's network with explicit recurrent state. Stateless itself: parameters, states and caches come from outside,
/// so that threads share one network with a workspace each.
template <class S>
class AgentNetwork {
 public:
  virtual ~AgentNetwork() = default;
  /// Tensors in the order of the flat vector, without gaps.
  virtual const std::vector<Tensor>& tensors() const = 0;
  /// Resizes and fills `parameters`.
  virtual void initialise(Random& random, Vector<S>& parameters) const = 0;
  virtual int state_size() const = 0;
  virtual std::unique_ptr<Workspace<S>> make_workspace() const = 0;
  /// `state` (state_size x B) is the state before the first step.
  virtual void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
                       Workspace<S>& workspace) const = 0;
  /// Adds to `gradient` (same layout as parameters) for the loss with these derivatives by the heads. Called after
  /// forward with the same arguments. Nothing flows into `state`.
  virtual void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                        const Heads<S>& derivative, Vector<S>& gradient) const = 0;

  std::ptrdiff_t parameter_count() const {
    return tensors().back().offset + tensors().back().rows * tensors().back().cols;
  }
};

/// Networks by name; float for work, double for the gradient checks.
template <class S>
using NetworkRegistry = Registry<AgentNetwork<S>, const NetworkTask&>;

/// A network file's last lines: registers `Network` in both precisions. `recommended` holds parameters of learner and
/// trainer with which this network learns well; "relabel.epochs" is for the learner relabel alone, over "epochs".
template <template <class> class Network>
struct NetworkRegistration {
  NetworkRegistration(const std::string& name, const std::string& help, const std::vector<ParameterSpec>& parameters,
                      const std::map<std::string, double>& recommended) {
    add<float>({name, help, parameters, {}, recommended});
    add<double>({name, help, parameters, {}, recommended});
  }

 private:
  template <class S>
  static void add(typename NetworkRegistry<S>::Entry entry) {
    entry.create = [](const Parameters& parameters, const NetworkTask& task) -> std::unique_ptr<AgentNetwork<S>> {
      return std::make_unique<Network<S>>(parameters, task);
    };
    typename NetworkRegistry<S>::Registration{std::move(entry)};
  }
};

}  // namespace citylearn
