// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>

#include "policy_service/learning/learner.h"
#include "policy_service/learning/optimization/loss_parts.h"

namespace citylearn {

/// Returns the parts of a flat vector before and after a tensor.
inline std::array<Eigen::VectorBlock<Vector<float>>, 2> beside(const Tensor& tensor, Vector<float>& flat) {
  return {flat.head(tensor.offset), flat.tail(flat.size() - tensor.offset - tensor.rows * tensor.cols)};
}

/// A part of a minibatch. A learner fills inputs and state, then forward(), then derivative, then backward().
class GradientShard {
 public:
  NetworkInputs<float> inputs;
  Matrix<float> state;      ///< before the first step
  Heads<float> derivative;  ///< of the loss, by the heads
  LossSums sums;            ///< of this step

  /// Returns the network's outputs for `inputs`.
  const Heads<float>& forward() {
    network_->forward(*parameters_, inputs, state, *workspace_);
    return workspace_->heads;
  }
  const Heads<float>& heads() const { return workspace_->heads; }  ///< as of the last forward()
  void backward() {
    for (auto part : beside(network_->joined_weights(), gradient_)) part.setZero();
    network_->backward(*parameters_, inputs, *workspace_, derivative, gradient_);
    network_->add_model_gradient(*parameters_, inputs, gradient_);
    differentiated_ = true;
  }

 private:
  friend class GradientStep;
  const AgentNetwork<float>* network_ = nullptr;
  const Vector<float>* parameters_ = nullptr;
  std::unique_ptr<Workspace<float>> workspace_;
  Vector<float> gradient_;       // of all but the joined weights
  bool differentiated_ = false;  // in this step
};

}  // namespace citylearn
