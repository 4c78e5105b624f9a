// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>

namespace citylearn {

struct FrameClassifierOptions {
  int hidden = 64;
  int epochs = 200;
  int batch = 64;
  double learning_rate = 3e-3;  ///< of Adam, falling linearly to 0
  double noise = 2;             ///< mean length of the noise on a training feature, relative to the feature's own
  std::uint64_t seed = 1;
  std::function<bool()> stop = nullptr;  ///< asked once an epoch: end early
};

/// The paper's classifier of single frames (Chancan & Milford, ICRA 2020, section IV): one multi-layer perceptron with
/// one hidden layer, trained on one traversal to classify its frames. It answers which frame a feature of another
/// traversal is, and with which probability. The same features, options and machine give the same numbers.
class FrameClassifier {
 public:
  /// D x R features, a class each. Throws Error: no frames, or options out of range.
  FrameClassifier(const Eigen::Ref<const Eigen::MatrixXf>& reference, const FrameClassifierOptions& options);
  /// R x Q: each column the probabilities of the reference's frames. Throws Error: another dimension.
  Eigen::MatrixXf probabilities(const Eigen::Ref<const Eigen::MatrixXf>& features) const;

 private:
  Eigen::VectorXf mean_;  ///< D
  float scale_ = 1;
  Eigen::MatrixXf hidden_weight_, output_weight_;  ///< H x D, R x H
  Eigen::VectorXf hidden_bias_, output_bias_;
};

}  // namespace citylearn
