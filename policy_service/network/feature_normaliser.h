// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// The features that were seen of a traversal: their sums, D numbers, and the number of frames.
struct SeenFeatures {
  Vector<double> sum;  ///< D; empty: nothing was seen
  double count = 0;

  void see(const Eigen::Ref<const Vector<float>>& features);
  void add(const SeenFeatures& more);
  /// Returns the D sums, then their number: what an exported model takes as `condition`.
  Vector<float> numbers() const;
};

/// Makes the features seen on one traversal comparable with those of the training traversal, whatever the condition:
///   x' = (x - c) / |x - c|,   c = (w m + sum of all x seen so far) / (w + their number),
/// where m is the mean of the training route's features, of all its experiences, and w = kPrior. Season, light and
/// camera move all features of a traversal alike, and c follows that move. Only what was seen before an action changes
/// it: nothing is known of the traversal beforehand. See docs/decisions/0018-normalisation.md.
class FeatureNormaliser {
 public:
  /// So many frames' weight the training mean has.
  static constexpr double kPrior = 16;

  /// Changes nothing: for networks without features, or with features that are pixels.
  FeatureNormaliser() = default;
  /// `reference`: D x N, features of the training route; empty: changes nothing.
  explicit FeatureNormaliser(const Matrix<float>& reference);

  /// Normalises each column of D numbers by what was seen before. A column equal to the mean becomes zero.
  void apply(Eigen::Ref<Matrix<float>> features, const SeenFeatures& seen = {}) const;
  /// Returns w m, D numbers.
  Vector<float> prior() const { return prior_.cast<float>(); }

 private:
  Vector<double> prior_;  ///< D, kPrior times the training mean; empty: changes nothing
};

/// Returns one FeatureNormaliser for each experience in `reference` (NetworkTask's, `frames` places each), which knows
/// this one alone: for frames of known experiences.
std::vector<FeatureNormaliser> normalisers_by_experience(const Matrix<float>& reference, int frames);

/// Returns the training route's features as these give them before anything was seen: what to compare normalised
/// features with. Each experience is a condition of its own, so its own mean centres it.
Matrix<float> normalised_reference(const Matrix<float>& reference, int frames);

}  // namespace citylearn
