// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

FeatureNormaliser::FeatureNormaliser(const Matrix<float>& reference) {
  if (reference.cols() == 0) return;
  prior_ = kPrior * reference.cast<double>().rowwise().mean();
  sum_.setZero(prior_.size());
}

void FeatureNormaliser::see(const Eigen::Ref<const Vector<float>>& features) {
  if (prior_.size() == 0) return;
  sum_ += features.cast<double>();
  ++count_;
}

void FeatureNormaliser::apply(Eigen::Ref<Matrix<float>> features) const {
  if (prior_.size() == 0) return;
  const Vector<float> centre = ((prior_ + sum_) / (kPrior + count_)).cast<float>();
  features.colwise() -= centre;
  for (auto column : features.colwise()) {
    const float length = column.norm();
    if (length > 0) column /= length;
  }
}

void FeatureNormaliser::see_and_apply(NetworkInputs<float>& inputs) {
  for (std::ptrdiff_t column = 0; column < inputs.steps * inputs.agents; ++column) see(inputs.features_of(column));
  apply(inputs.features.leftCols(inputs.distinct));
}

Vector<float> FeatureNormaliser::seen() const {
  Vector<float> seen(sum_.size() + 1);
  seen << sum_.cast<float>(), static_cast<float>(count_);
  return seen;
}

std::vector<FeatureNormaliser> normalisers_by_experience(const Matrix<float>& reference, int frames) {
  std::vector<FeatureNormaliser> all;
  for (std::ptrdiff_t first = 0; first + frames <= reference.cols(); first += frames)
    all.emplace_back(reference.middleCols(first, frames));
  return all;
}

Matrix<float> normalised_reference(const Matrix<float>& reference, int frames) {
  Matrix<float> normalised = reference;
  std::ptrdiff_t first = 0;
  for (const FeatureNormaliser& normaliser : normalisers_by_experience(reference, frames)) {
    normaliser.apply(normalised.middleCols(first, frames));
    first += frames;
  }
  return normalised;
}

}  // namespace citylearn
