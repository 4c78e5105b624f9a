// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "policy_service/network/lstm.h"
#include "policy_service/network/place_keys.h"
#include "policy_service/network/product.h"

namespace citylearn {
namespace {

/// Soft attention over the route's places in front of an LSTM: place_filter without its knowledge of motion. It is
/// given the reference frames' features K as keys; what it attends to says where it stands, and the LSTM has to learn
/// to join that over time.
///
/// a = softmax(s (x . K_i)) over the places, s learned. Sensors: the expected place 4 (E i / N - 1/2), the expected way
/// to the goal E 2 tanh((goal - i) / 8), 2 P(i < goal), 2 P(i > goal), the sharpness of the attention |a|^2, and the
/// goal destination 4 (goal / N - 1/2); then as `features`.
template <class S>
class PlaceMemory : public LstmNetwork<S> {
  using Base = LstmNetwork<S>;
  using typename Base::Work;

 public:
  PlaceMemory(const Parameters& parameters, const NetworkTask& task)
      : Base(parameters, kSensors), places_(task.frames), keys_(task.reference, task.features, task.frames) {
    if (task.streets)
      throw Error("knows the places of a line, not of streets", "network place_memory", "choose --agent place_filter");
    sharpness_ = this->layout_.add("attention.sharpness", 1, 1);
    way_.resize(2 * places_);
    for (int difference = -places_; difference < places_; ++difference)
      way_(places_ + difference) = auxiliary_targets<S>(0, difference, places_)[1];
  }

  static std::vector<ParameterSpec> parameters() {
    std::vector<ParameterSpec> specs = Base::lstm_parameters();
    for (ParameterSpec& spec : specs)
      if (spec.name == "hidden" || spec.name == "cells") spec.default_value = 64;
    return specs;
  }

  bool normalises() const override { return true; }
  std::unique_ptr<Workspace<S>> make_workspace() const override { return std::make_unique<Attention>(); }

  void initialise(Random& random, Vector<S>& parameters) const override {
    Base::initialise(random, parameters);
    this->layout_.view(parameters, sharpness_)(0) = static_cast<S>(std::log(30.0) / kStretch);
  }

 protected:
  void embed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
             Eigen::Block<Matrix<S>> embedded) const override {
    Attention& attention = static_cast<Attention&>(work);
    const std::ptrdiff_t places = inputs.frames;
    keys_.compare(inputs.features.leftCols(inputs.distinct), places, attention.similarities, attention.similarity);
    attention.weights = scale(parameters) * attention.similarity;
    for (std::ptrdiff_t thing = 0; thing < inputs.distinct; ++thing) {
      auto weights = attention.weights.col(thing);
      weights = (weights.array() - weights.maxCoeff()).exp();
      weights /= weights.sum();
    }
    work.sensed.setZero(kSensors, embedded.cols());
    for (std::ptrdiff_t column = 0; column < work.sensed.cols(); ++column) {
      const auto index = static_cast<std::size_t>(column);
      const int goal = inputs.goal[index];
      const auto weights = attention.weights.col(inputs.seen[index]);
      auto sensed = work.sensed.col(column);
      for (int place = 0; place < inputs.frames; ++place) sensed += weights(place) * value(place, goal);
      sensed(kSharpness) = weights.squaredNorm();
      sensed(kGoal) = S(4) * (static_cast<S>(goal) / static_cast<S>(places_) - S(0.5));
    }
    set_product(embedded, this->layout_.view(parameters, this->sensor_weights_), work.sensed);
    embedded.colwise() += this->layout_.view(parameters, this->sensor_bias_).col(0);
  }

  void unembed(const Vector<S>& parameters, const NetworkInputs<S>& inputs, Work& work,
               Vector<S>& gradient) const override {
    Base::unembed(parameters, inputs, work, gradient);
    Attention& attention = static_cast<Attention&>(work);
    attention.by_sensed.noalias() =
        this->layout_.view(parameters, this->sensor_weights_).transpose() * work.embedded_gradient;
    S by_scale = 0;
    for (std::ptrdiff_t column = 0; column < attention.by_sensed.cols(); ++column) {
      const auto index = static_cast<std::size_t>(column);
      const auto by_sensed = attention.by_sensed.col(column);
      const auto weights = attention.weights.col(inputs.seen[index]);
      const auto similarity = attention.similarity.col(inputs.seen[index]);
      const S mean = weights.dot(similarity);
      for (int place = 0; place < inputs.frames; ++place) {
        const S by_weight =
            by_sensed.dot(value(place, inputs.goal[index])) + S(2) * by_sensed(kSharpness) * weights(place);
        by_scale += weights(place) * (similarity(place) - mean) * by_weight;
      }
    }
    this->layout_.view(gradient, sharpness_)(0) += static_cast<S>(kStretch) * scale(parameters) * by_scale;
  }

 private:
  enum { kPlace, kWay, kBefore, kAfter, kSharpness, kGoal, kSensors };

  struct Attention : Work {
    Matrix<S> similarities;         // EN x U
    Matrix<S> similarity, weights;  // places in use x U
    Matrix<S> by_sensed;            // sensors x TB
  };

  S scale(const Vector<S>& parameters) const {
    return std::exp(static_cast<S>(kStretch) * this->layout_.view(parameters, sharpness_)(0));
  }

  /// Returns what attention to `place` adds to each sensor.
  Eigen::Matrix<S, kSensors, 1> value(int place, int goal) const {
    Eigen::Matrix<S, kSensors, 1> value;
    value << S(4) * (static_cast<S>(place) / static_cast<S>(places_) - S(0.5)), way_(places_ + goal - place),
        S(place < goal ? 2 : 0), S(place > goal ? 2 : 0), S(0), S(0);
    return value;
  }

  int places_;
  PlaceKeys<S> keys_;
  Vector<S> way_;  ///< 2N, 2 tanh(difference / 8) for differences -N .. N - 1
  std::size_t sharpness_;
};

const NetworkRegistration<PlaceMemory> place_memory_registration{
    "place_memory",
    "attention over the training route's places in front of an LSTM; place_filter learns faster and generalises better",
    PlaceMemory<NetworkScalar>::parameters(),
    PlaceMemory<NetworkScalar>::recommended({{"agents", 16},
                                             {"sequence", 64},
                                             {"steps", 120000},
                                             {"noise-frame", 0.5},
                                             {"noise-episode", 1},
                                             {"minibatch", 4},
                                             {"epochs", 3},
                                             {"learning-rate", 2e-3},
                                             {"gamma", 0.9},
                                             {"lambda", 0.8},
                                             {"entropy", 0.05},
                                             {"localisation", 1}})};

}  // namespace
}  // namespace citylearn
