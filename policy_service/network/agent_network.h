// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "core/plugin/registry.h"
#include "core/util/random.h"
#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// Number type of the registered networks: float. The gradient checks compile the networks once more in double.
#ifdef CITYLEARN_DOUBLE_NETWORKS
using NetworkScalar = double;
#else
using NetworkScalar = float;
#endif

/// Results of a forward pass, and what the network keeps for the backward pass. Reusable: nothing is allocated while
/// the sizes stay the same.
template <class S>
struct Workspace {
  virtual ~Workspace() = default;
  bool localise = false;  ///< asks for `heads.auxiliary`; only a training loss does
  /// If not 0, no backward pass follows, and the parameters are the same as long as this number is: a network may then
  /// keep what it computed from them, and from a feature vector.
  std::uint64_t fixed = 0;
  /// Asks backward() for `left` and `right` in the place of the gradient of AgentNetwork::joined_weights().
  bool joins = false;
  const Matrix<S>*left = nullptr, *right = nullptr;  ///< rows x TB, cols x TB
  Heads<S> heads;
  Matrix<S> state;  ///< state_size x B, after the last step
};

/// An agent's network with explicit recurrent state. It is stateless itself: parameters, states and caches are
/// arguments, so that threads share one network with a workspace each.
template <class S>
class AgentNetwork {
 public:
  virtual ~AgentNetwork() = default;
  /// Returns the tensors in the order of the flat vector, without gaps.
  virtual const std::vector<Tensor>& tensors() const = 0;
  /// Resizes and fills `parameters`.
  virtual void initialise(Random& random, Vector<S>& parameters) const = 0;
  virtual int state_size() const = 0;
  /// Returns the belief over the places that a state holds, as scores whose softmax it is; empty: there is none.
  virtual Vector<S> belief(const Eigen::Ref<const Vector<S>>& /*state*/) const { return {}; }
  /// Returns whether it wants features as FeatureNormaliser makes them (feature_normaliser.h). The caller
  /// has to see to that.
  virtual bool normalises() const { return false; }
  virtual std::unique_ptr<Workspace<S>> make_workspace() const = 0;
  /// `state` (state_size x B) is the state before the first step.
  virtual void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
                       Workspace<S>& workspace) const = 0;
  /// Adds to `gradient` (same layout as parameters) for the loss with these derivatives by the heads. Call it after
  /// forward() with the same arguments. No gradient flows into `state`.
  virtual void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                        const Heads<S>& derivative, Vector<S>& gradient) const = 0;
  /// Returns the weights, if there are any, whose gradient is the sum of left * right' of all workspaces: threads may
  /// compute parts of it, instead of one for each workspace that is added to the others.
  virtual Tensor joined_weights() const { return {}; }
  /// Adds to `gradient` for what the network learns beside the loss: its model of the world, from what happened in
  /// training. The heads' derivatives do not reach these parameters.
  virtual void add_model_gradient(const Vector<S>& parameters, const NetworkInputs<S>& inputs,
                                  Vector<S>& gradient) const {
    static_cast<void>(parameters), static_cast<void>(inputs), static_cast<void>(gradient);
  }

  std::ptrdiff_t parameter_count() const {
    return tensors().back().offset + tensors().back().rows * tensors().back().cols;
  }
};

/// Networks by name.
template <class S>
using NetworkRegistry = Registry<AgentNetwork<S>, const NetworkTask&>;

/// Registers `Network`, as the last lines of its file. `recommended` holds parameters of learner and trainer with which
/// this network learns well; "relabel.epochs" is for the learner relabel alone, over "epochs", and
/// "streets.noise-place" for streets alone, over both.
template <template <class> class Network, class S = NetworkScalar>
struct NetworkRegistration {
  NetworkRegistration(const std::string& name, const std::string& help, const std::vector<ParameterSpec>& parameters,
                      const std::map<std::string, double>& recommended) {
    typename NetworkRegistry<S>::Registration{
        {name, help, parameters,
         [](const Parameters& given, const NetworkTask& task) { return std::make_unique<Network<S>>(given, task); },
         recommended}};
  }
};

}  // namespace citylearn
