// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/network/network_inputs.h"

namespace citylearn {

/// Makes the features seen on one traversal comparable with those of the training traversal, whatever the condition:
///   x' = (x - c) / |x - c|,   c = (w m + sum of all x seen so far) / (w + their number),
/// where m is the mean of the training route's features, of all its experiences, and w = kPrior. Season, light and
/// camera move all features of a traversal alike, and c follows that move. Only what was seen before an action, by all
/// agents on the traversal, changes it: nothing is known of the traversal beforehand. See
/// docs/decisions/0018-normalisation.md.
class FeatureNormaliser {
 public:
  /// So many frames' weight the training mean has.
  static constexpr double kPrior = 16;

  /// Changes nothing: for networks without features, or with features that are pixels.
  FeatureNormaliser() = default;
  /// `reference`: D x N, features of the training route; empty: changes nothing.
  explicit FeatureNormaliser(const Matrix<float>& reference);

  /// Takes in what one agent sees, D numbers.
  void see(const Eigen::Ref<const Vector<float>>& features);
  /// Normalises each column of D numbers by what was seen so far. A column equal to the mean becomes zero.
  void apply(Eigen::Ref<Matrix<float>> features) const;
  /// Takes in what each column of `inputs` shows, then normalises all of it.
  void see_and_apply(NetworkInputs<float>& inputs);
  /// Returns the D sums of what was seen, then its number: what an exported model takes as `condition`.
  Vector<float> seen() const;
  /// Returns w m, D numbers.
  Vector<float> prior() const { return prior_.cast<float>(); }

 private:
  Vector<double> prior_, sum_;  ///< D, kPrior times the training mean; of what was seen; empty: changes nothing
  double count_ = 0;
};

/// Returns one FeatureNormaliser for each experience in `reference` (NetworkTask's, `frames` places each), which knows
/// this one alone: for frames of known experiences.
std::vector<FeatureNormaliser> normalisers_by_experience(const Matrix<float>& reference, int frames);

/// Returns the training route's features as these give them before anything was seen: what to compare normalised
/// features with. Each experience is a condition of its own, so its own mean centres it.
Matrix<float> normalised_reference(const Matrix<float>& reference, int frames);

}  // namespace citylearn
