// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/recognition/classifier.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <vector>

#include "core/util/error.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

/// Kingma & Ba, ICLR 2015.
class Adam {
 public:
  explicit Adam(Eigen::Index size) : mean_(Eigen::ArrayXf::Zero(size)), square_(Eigen::ArrayXf::Zero(size)) {}
  void step(Eigen::Map<Eigen::ArrayXf> values, const Eigen::Map<const Eigen::ArrayXf>& gradient, double rate,
            int time) {
    mean_ = 0.9f * mean_ + 0.1f * gradient;
    square_ = 0.999f * square_ + 0.001f * gradient.square();
    const float size = static_cast<float>(rate * std::sqrt(1 - std::pow(0.999, time)) / (1 - std::pow(0.9, time)));
    values -= size * mean_ / (square_.sqrt() + 1e-8f);
  }

 private:
  Eigen::ArrayXf mean_, square_;
};

Eigen::MatrixXf normal_matrix(Eigen::Index rows, Eigen::Index columns, double deviation, Random& random) {
  Eigen::MatrixXf matrix(rows, columns);
  for (Eigen::Index i = 0; i < matrix.size(); ++i) matrix.data()[i] = static_cast<float>(deviation * random.normal());
  return matrix;
}

void softmax(Eigen::MatrixXf& columns) {
  columns.rowwise() -= columns.colwise().maxCoeff().eval();
  columns = columns.array().exp();
  columns.array().rowwise() /= columns.colwise().sum().array().eval();
}

template <class Values, class Gradient>
void update(Adam& adam, Values& values, const Gradient& gradient, double rate, int time) {
  adam.step({values.data(), values.size()}, {gradient.data(), gradient.size()}, rate, time);
}

}  // namespace

FrameClassifier::FrameClassifier(const Eigen::Ref<const Eigen::MatrixXf>& reference,
                                 const FrameClassifierOptions& options) {
  const Eigen::Index dimension = reference.rows(), frames = reference.cols();
  if (frames == 0 || dimension == 0) throw Error("a classifier needs frames to learn from");
  if (options.hidden < 1 || options.epochs < 1 || options.batch < 1 || !(options.learning_rate > 0))
    throw Error("hidden units, epochs, batch and learning rate of a classifier must be more than 0");
  // Components of a unit vector are about 1/sqrt(D): brought to about 1, where the layer's start expects them.
  mean_ = reference.rowwise().mean();
  Eigen::MatrixXf inputs = reference.colwise() - mean_;
  const double length = inputs.colwise().norm().mean();
  scale_ = length > 0 ? static_cast<float>(std::sqrt(static_cast<double>(dimension)) / length) : 1;
  inputs *= scale_;

  Random random{options.seed, 0x4D4C50ull};
  hidden_weight_ = normal_matrix(options.hidden, dimension, std::sqrt(2.0 / static_cast<double>(dimension)), random);
  output_weight_ = normal_matrix(frames, options.hidden, std::sqrt(1.0 / options.hidden), random);
  hidden_bias_ = Eigen::VectorXf::Zero(options.hidden);
  output_bias_ = Eigen::VectorXf::Zero(frames);
  Adam hidden_weight(hidden_weight_.size()), output_weight(output_weight_.size()), hidden_bias(options.hidden),
      output_bias(frames);

  // Drawing fresh noise would take longer than learning: each feature takes a stretch of a long strip of it.
  const Eigen::Index strip = dimension + 65536;
  const Eigen::MatrixXf noise = normal_matrix(strip, 1, options.noise, random);
  std::vector<int> order(static_cast<std::size_t>(frames));
  std::iota(order.begin(), order.end(), 0);
  const int batches = static_cast<int>((frames + options.batch - 1) / options.batch);
  const double steps = static_cast<double>(options.epochs) * batches;
  int time = 0;
  for (int epoch = 0; epoch < options.epochs; ++epoch) {
    if (options.stop && options.stop()) return;
    for (std::size_t i = order.size() - 1; i > 0; --i) std::swap(order[i], order[random.below(i + 1)]);
    for (Eigen::Index first = 0; first < frames; first += options.batch) {
      const Eigen::Index size = std::min<Eigen::Index>(options.batch, frames - first);
      Eigen::MatrixXf input(dimension, size);
      for (Eigen::Index i = 0; i < size; ++i) {
        const auto from = static_cast<Eigen::Index>(random.below(static_cast<std::uint64_t>(strip - dimension)));
        input.col(i) = inputs.col(order[first + i]) + noise.col(0).segment(from, dimension);
      }
      Eigen::MatrixXf hidden = hidden_weight_ * input;
      hidden.colwise() += hidden_bias_;
      hidden = hidden.cwiseMax(0);
      Eigen::MatrixXf output = output_weight_ * hidden;
      output.colwise() += output_bias_;
      softmax(output);
      // From here on `output` is the gradient of the mean cross-entropy with respect to the logits.
      for (Eigen::Index i = 0; i < size; ++i) output(order[first + i], i) -= 1;
      output /= static_cast<float>(size);
      Eigen::MatrixXf back = output_weight_.transpose() * output;
      back = back.array() * (hidden.array() > 0).cast<float>();
      const Eigen::MatrixXf output_gradient = output * hidden.transpose(), hidden_gradient = back * input.transpose();
      const Eigen::VectorXf output_bias_gradient = output.rowwise().sum(), hidden_bias_gradient = back.rowwise().sum();
      const double rate = options.learning_rate * (1 - time / steps);
      ++time;
      update(output_weight, output_weight_, output_gradient, rate, time);
      update(hidden_weight, hidden_weight_, hidden_gradient, rate, time);
      update(output_bias, output_bias_, output_bias_gradient, rate, time);
      update(hidden_bias, hidden_bias_, hidden_bias_gradient, rate, time);
    }
  }
}

Eigen::MatrixXf FrameClassifier::probabilities(const Eigen::Ref<const Eigen::MatrixXf>& features) const {
  if (features.rows() != hidden_weight_.cols())
    throw Error("the classifier learned features of " + std::to_string(hidden_weight_.cols()) +
                " dimensions, these have " + std::to_string(features.rows()));
  Eigen::MatrixXf hidden = hidden_weight_ * (scale_ * (features.colwise() - mean_));
  hidden.colwise() += hidden_bias_;
  hidden = hidden.cwiseMax(0);
  Eigen::MatrixXf output = output_weight_ * hidden;
  output.colwise() += output_bias_;
  softmax(output);
  return output;
}

}  // namespace citylearn
