// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "policy_service/network/autodiff/functions.h"
#include "policy_service/network/autodiff/operations.h"
#include "policy_service/network/autodiff/shapes.h"
#include "policy_service/network/layers/layers.h"

namespace citylearn {

/// The inputs of a forward pass.
template <class S>
struct ForwardPass {
  Tape<S>& tape;
  const NetworkInputs<S>& inputs;
  std::vector<Variable<S>> tensors;  ///< by the numbers that weights() and bias() returned
  Variable<S> state;                 ///< state_size x B, before the first step; constant
  bool localise;                     ///< whether ForwardResult::auxiliary is asked for
  Workspace<S>& workspace;           ///< as make_workspace() made it, for what a network keeps beside the tape

  /// Returns D x U, constant; gather_columns(_, inputs.seen) makes it D x TB.
  Variable<S> features() const;
  /// Returns 1 x TB, constant: the goal as a share of a route of `frames` places, less 1/2.
  Variable<S> goals(int frames) const;
  /// Returns 6 x TB, constant: the previous action, one-hot, and 1 for each forbidden action.
  Variable<S> actions() const;
  /// Returns `state` (any rows x B) with columns of zeros for agents whose episode begins at `step`.
  Variable<S> wiped(const Variable<S>& state, int step) const;
};

/// The results of a forward pass.
template <class S>
struct ForwardResult {
  Variable<S> logits;          ///< 3 x TB, before the mask
  Variable<S> values;          ///< 1 x TB
  Variable<S> state;           ///< state_size x B, after the last step
  Variable<S> auxiliary = {};  ///< 2 x TB (Heads::auxiliary), or nothing
};

/// A network that is written as a forward pass alone; a tape computes its gradient. It allocates at each pass; an LSTM
/// takes about 1.3 times as long to train as the one written by hand. A subclass declares its tensors in its
/// constructor and defines run() and state_size(). Header-only, so that a plug-in may register it in float and in
/// double.
template <class S>
class AutodiffNetwork : public AgentNetwork<S> {
 public:
  const std::vector<Tensor>& tensors() const override { return layout_.tensors(); }
  void initialise(Random& random, Vector<S>& parameters) const override;
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Work>(); }
  void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
               Workspace<S>& workspace) const override;
  void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                const Heads<S>& derivative, Vector<S>& gradient) const override;

 protected:
  /// Declares a tensor that begins as a random orthogonal matrix times `gain`; returns its number.
  std::size_t weights(const std::string& name, std::ptrdiff_t rows, std::ptrdiff_t cols, double gain = 1) {
    starts_.push_back({gain, 0});
    return layout_.add(name, rows, cols);
  }
  /// Declares a column that begins with this value everywhere; returns its number.
  std::size_t bias(const std::string& name, std::ptrdiff_t rows, double value = 0) {
    starts_.push_back({0, value});
    return layout_.add(name, rows, 1);
  }
  /// Computes the heads of all steps. Throws Error when sizes do not fit.
  virtual ForwardResult<S> run(const ForwardPass<S>& pass) const = 0;

  struct Work : Workspace<S> {
    Tape<S> tape;
    std::vector<Variable<S>> tensors;
    ForwardResult<S> result;
  };

 private:
  struct Start {
    double gain, value;
  };

  TensorLayout layout_;
  std::vector<Start> starts_;  // by tensor
};

}  // namespace citylearn

#include "policy_service/network/autodiff/autodiff_network_impl.h"
