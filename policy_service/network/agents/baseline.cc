// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/layers/lstm.h"

namespace citylearn {
namespace {

/// The paper's baseline: sees its position p_t = frame / N in the place of the frame's features, and the goal
/// destination g_t = goal / N (section IV).
template <class S>
class Baseline : public LstmNetwork<S> {
 public:
  Baseline(const Parameters& parameters, const NetworkTask& task)
      : LstmNetwork<S>(parameters, 2),
        frames_(task.frames),
        places_(task.places()),
        scale_(static_cast<S>(parameters["scale"])) {}

  static std::vector<ParameterSpec> parameters() {
    std::vector<ParameterSpec> specs = LstmNetwork<S>::lstm_parameters();
    specs.push_back({"scale", "position and goal, moved to -0.5..0.5, are multiplied by this", 64, 1e-3, 1e3});
    return specs;
  }

 protected:
  void sense(const NetworkInputs<S>& inputs, Matrix<S>& sensed) const override {
    for (std::ptrdiff_t column = 0; column < sensed.cols(); ++column) {
      const std::size_t index = static_cast<std::size_t>(column);
      sensed(0, column) = scale_ * (static_cast<S>(inputs.position[index]) / static_cast<S>(frames_) - S(0.5));
      sensed(1, column) = scale_ * (static_cast<S>(inputs.goal[index]) / static_cast<S>(places_) - S(0.5));
    }
  }

 private:
  int frames_, places_;
  S scale_;
};

const NetworkRegistration<Baseline> baseline_registration{
    "baseline", "the paper's baseline: sees its position and the goal -> linear 512 -> LSTM 256",
    Baseline<NetworkScalar>::parameters(),
    Baseline<NetworkScalar>::recommended({{"agents", 16},
                                          {"sequence", 64},
                                          {"steps", 220000},
                                          {"noise-frame", 0},
                                          {"noise-episode", 0},
                                          {"minibatch", 4},
                                          {"epochs", 3},
                                          {"learning-rate", 1e-3},
                                          {"gamma", 0.9},
                                          {"lambda", 0.9}})};

}  // namespace
}  // namespace citylearn
