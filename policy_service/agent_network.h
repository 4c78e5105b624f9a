#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/random.h"
#include "core/registry.h"

namespace citylearn {

template <class S>
using Matrix = Eigen::Matrix<S, Eigen::Dynamic, Eigen::Dynamic>;  // column-major: a column is a sample
template <class S>
using Vector = Eigen::Matrix<S, Eigen::Dynamic, 1>;

/// What a network is built for.
struct NetworkTask {
  int features = 0;                 ///< D
  int frames = 128;                 ///< N, places on the route (of the last lesson)
  Matrix<float> reference;          ///< D x N, features of the training traversal's route: the place memory of networks that have one
};

/// Observations of B agents over T steps; column t * B + b is agent b at step t.
template <class S>
struct NetworkInputs {
  int steps = 0;                    ///< T
  int agents = 0;                   ///< B
  Matrix<S> features;               ///< D x TB
  std::vector<int> goal;            ///< TB, place on the route, 0..N-1
  std::vector<int> position;        ///< TB, place on the route; for the baseline network and for losses, never for navigators' eyes
  std::vector<std::uint8_t> previous_action;  ///< TB, kNoAction at an episode's start
  std::vector<std::uint8_t> allowed;          ///< TB, bit a = action a allowed
  std::vector<std::uint8_t> first;            ///< TB, 1 = first observation of an episode: the state before it is zeroed
  void resize(int feature_dimension, int step_count, int agent_count);
};

/// One named tensor within the flat vector of parameters.
struct Tensor {
  std::string name;
  int rows = 0, cols = 0;
  std::ptrdiff_t offset = 0;
};

/// Results of a forward pass, and whatever the network keeps for the backward pass. Used again and again: no allocation in
/// steady state.
template <class S>
struct Workspace {
  virtual ~Workspace() = default;
  Matrix<S> logits;                 ///< 3 x TB, masked actions at -1e9
  Matrix<S> values;                 ///< 1 x TB
  Matrix<S> state;                  ///< state_size x B, after the last step
};

/// An agent's network with explicit recurrent state. Stateless itself: parameters, states and caches come from outside, so
/// that threads share one network with a workspace each.
template <class S>
class AgentNetwork {
 public:
  virtual ~AgentNetwork() = default;
  /// Tensors in the order of the flat vector.
  virtual const std::vector<Tensor>& tensors() const = 0;
  virtual void initialise(Random& random, Vector<S>& parameters) const = 0;
  virtual int state_size() const = 0;
  virtual std::unique_ptr<Workspace<S>> make_workspace() const = 0;
  /// `state` (state_size x B) is the state before the first step.
  virtual void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
                       Workspace<S>& workspace) const = 0;
  /// Adds to `gradient` (same layout as parameters) for the loss whose derivatives by logits (3 x TB) and values (1 x TB)
  /// are given. Called after forward with the same arguments. No gradient flows into `state`.
  virtual void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                        const Matrix<S>& logits_gradient, const Matrix<S>& values_gradient, Vector<S>& gradient) const = 0;
};

/// Networks by name; float for work, double for the gradient checks.
template <class S>
using NetworkRegistry = Registry<AgentNetwork<S>, const NetworkTask&>;

}  // namespace citylearn
