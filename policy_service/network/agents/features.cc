// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/layers/lstm.h"

namespace citylearn {
namespace {

/// The paper's agent: sees the bimodal vector b_t = [x_t, g_t], the frame's features and the goal destination g_t =
/// goal / N (section III). Features of unit length have small components, hence the scale.
template <class S>
class Features : public LstmNetwork<S> {
 public:
  Features(const Parameters& parameters, const NetworkTask& task)
      : LstmNetwork<S>(parameters, task.features + 1),
        places_(task.places()),
        scale_(static_cast<S>(parameters["scale"])),
        goal_scale_(static_cast<S>(parameters["goal-scale"])) {
    if (task.features < 1)
      throw Error("needs features", "features", "give the env_service a features file or start an encoder_service");
  }

  bool normalises() const override { return true; }

  static std::vector<ParameterSpec> parameters() {
    std::vector<ParameterSpec> specs = LstmNetwork<S>::lstm_parameters();
    specs.push_back({"scale", "features are multiplied by this", 8, 1e-3, 1e3});
    specs.push_back({"goal-scale", "the goal destination, moved to -0.5..0.5, is multiplied by this", 16, 1e-3, 1e3});
    return specs;
  }

 protected:
  void sense(const NetworkInputs<S>& inputs, Matrix<S>& sensed) const override {
    for (std::ptrdiff_t column = 0; column < sensed.cols(); ++column) {
      const auto index = static_cast<std::size_t>(column);
      sensed.col(column).head(sensed.rows() - 1) = scale_ * inputs.features_of(column);
      sensed(sensed.rows() - 1, column) =
          goal_scale_ * (static_cast<S>(inputs.goal[index]) / static_cast<S>(places_) - S(0.5));
    }
  }

 private:
  int places_;
  S scale_, goal_scale_;
};

const NetworkRegistration<Features> features_registration{
    "features", "the paper's agent: frame features and goal -> linear 512 -> LSTM 256",
    Features<NetworkScalar>::parameters(),
    Features<NetworkScalar>::recommended({{"agents", 32},
                                          {"sequence", 32},
                                          {"steps", 360000},
                                          {"noise-frame", 0.5},
                                          {"noise-place", 1},
                                          {"noise-episode", 0.4},
                                          {"step-cost", 0.05},
                                          {"minibatch", 8},
                                          {"epochs", 2},
                                          {"relabel.epochs", 4},
                                          {"relabel.relabelled", 0.5},
                                          {"relabel.entropy", 0.01},
                                          {"relabel.steps", 120000},
                                          {"learning-rate", 1.5e-3},
                                          {"gamma", 0.93},
                                          {"lambda", 0.8},
                                          {"localisation", 3}})};

}  // namespace
}  // namespace citylearn
