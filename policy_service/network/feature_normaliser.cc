// SPDX-License-Identifier: Apache-2.0
#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

void SeenFeatures::see(const Eigen::Ref<const Vector<float>>& features) {
  if (sum.size() == 0) sum.setZero(features.size());
  sum += features.cast<double>();
  ++count;
}

void SeenFeatures::add(const SeenFeatures& more) {
  if (more.count == 0) return;
  if (sum.size() == 0) sum.setZero(more.sum.size());
  sum += more.sum;
  count += more.count;
}

Vector<float> SeenFeatures::numbers() const {
  Vector<float> numbers(sum.size() + 1);
  numbers << sum.cast<float>(), static_cast<float>(count);
  return numbers;
}

FeatureNormaliser::FeatureNormaliser(const Matrix<float>& reference) {
  if (reference.cols() > 0) prior_ = kPrior * reference.cast<double>().rowwise().mean();
}

void FeatureNormaliser::apply(Eigen::Ref<Matrix<float>> features, const SeenFeatures& seen) const {
  if (prior_.size() == 0) return;
  Vector<float> centre;
  if (seen.count > 0)
    centre = ((prior_ + seen.sum) / (kPrior + seen.count)).cast<float>();
  else
    centre = (prior_ / kPrior).cast<float>();
  features.colwise() -= centre;
  for (auto column : features.colwise()) {
    const float length = column.norm();
    if (length > 0) column /= length;
  }
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
