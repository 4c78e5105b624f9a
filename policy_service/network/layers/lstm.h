// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "layers.h"
#include "packed_weights.h"

namespace citylearn {

/// The recurrent agent of the paper (Fig. 4): sensors -> linear `hidden` -> concatenated with the previous action,
/// one-hot -> LSTM `cells` -> policy (3) and value (1). A subclass defines the sensors.
///
/// A training loss may ask for one more head, the auxiliary targets (2); a deployed agent never computes it. With
/// `mask-input` the forbidden actions are concatenated too.
template <class S>
class LstmNetwork : public AgentNetwork<S> {
 public:
  LstmNetwork(const Parameters& parameters, int sensors);

  static std::vector<ParameterSpec> lstm_parameters() {
    return {{"hidden", "units of the linear layer", 512, 1, 8192, true},
            {"cells", "cells of the LSTM", 256, 1, 8192, true},
            {"relu", "nonlinearity of the linear layer: 1 relu, 0 tanh", 1, 0, 1, true},
            {"mask-input", "1: the agent sees which actions are not allowed", 1, 0, 1, true}};
  }

  /// Returns what an LSTM agent recommends (NetworkRegistration): `own`, and the values that most of them share.
  static std::map<std::string, double> recommended(std::map<std::string, double> own) {
    own.insert({{"segment", 64}, {"value-clip", 0}, {"entropy", 0.02}, {"entropy-until", 1}, {"orientation", 1}});
    return own;
  }

  const std::vector<Tensor>& tensors() const override { return layout_.tensors(); }
  int state_size() const override { return 2 * cells_; }  // h, then c
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Work>(); }

  void initialise(Random& random, Vector<S>& parameters) const override;

  void forward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, const Matrix<S>& state,
               Workspace<S>& workspace) const override;

  void backward(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Workspace<S>& workspace,
                const Heads<S>& derivative, Vector<S>& gradient) const override;

  /// Returns the weights of all that enters the gates: their two tensors lie one after the other.
  Tensor joined_weights() const override {
    const Tensor& inputs = layout_.tensors()[input_weights_];
    return {"lstm", inputs.rows, inputs.cols + cells_, inputs.offset};
  }

 protected:
  struct Work : Workspace<S> {
    Matrix<S> sensed;                         // sensors x TB
    Matrix<S> lstm_input;                     // hidden + extra + cells x TB; the last are h before the step
    Matrix<S> gates;                          // 4 cells x TB: input, forget, output, candidate
    Matrix<S> before_c;                       // cells x TB: before the step, as h is zero at an episode's start
    Matrix<S> h, c, tanh_c;                   // cells x TB
    Matrix<S> both;                           // 4 x TB: logits and value
    Matrix<S> h_gradient, embedded_gradient;  // cells x TB, hidden x TB
    Matrix<S> carried_h, carried_c;           // cells x B: from the later step
    PackedWeights<S> sensor_weights, input_weights, recurrent_weights, recurrent_back;
    std::uint64_t packed_of = 0;  // the value of `fixed` for which the first three are packed
    Vector<S> column;             // cells
  };

  /// Fills `sensed` (sensors x TB, already of that size). A subclass whose sensors learn overrides the two below
  /// instead.
  virtual void sense(const NetworkInputs<S>& /*inputs*/, Matrix<S>& /*sensed*/) const {}
  /// Fills `embedded` (hidden x TB): the linear layer, before its nonlinearity.
  virtual void embed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
                     Eigen::Block<Matrix<S>> embedded) const;
  /// Adds to `gradient` what follows from `work.embedded_gradient`, the derivative by what embed() filled in.
  virtual void unembed(const Vector<S>& /*parameters*/, const NetworkInputs<S>& /*inputs*/, Work& work,
                       Vector<S>& gradient) const;

  TensorLayout layout_;
  std::size_t sensor_weights_, sensor_bias_;

 private:
  void resize(Work& work, std::ptrdiff_t agents, std::ptrdiff_t columns) const;

  void append_actions(const NetworkInputs<S>& inputs, Matrix<S>& lstm_input) const;

  int sensors_, hidden_, cells_, extra_;
  bool rectified_;
  std::size_t input_weights_, recurrent_weights_, gate_bias_, head_weights_, head_bias_, auxiliary_weights_,
      auxiliary_bias_;
};

}  // namespace citylearn
