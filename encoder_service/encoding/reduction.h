// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// The mean that is subtracted from a traversal's descriptors before anything else.
enum class Centring {
  kNone,
  kReference,  ///< the mean of the reference traversal
  kOwn,        ///< the traversal's own mean: needs all of it
  kRunning,    ///< the mean of its frames so far, with the reference's mean as a prior: works online
};
/// Parses "none", "reference", "own" or "running". Throws Error listing them.
Centring centring_of(const std::string& name);
std::string name_of(Centring centring);

struct ReductionOptions {
  Centring centring = Centring::kRunning;
  int dimension = 64;      ///< d after PCA; 0 = no PCA: centred and scaled to length 1 only; without centring as it is
  double whitening = 0.2;  ///< exponent e of the eigenvalues: components are divided by eigenvalue^e; 0 none, 0.5 full

  /// Returns whether a reference traversal teaches it anything.
  bool learns() const { return dimension > 0 || centring == Centring::kReference || centring == Centring::kRunning; }
  /// Returns whether descriptors stay as they are: what networks see that learn their own features from pixels.
  bool keeps_all() const { return centring == Centring::kNone && dimension == 0; }
};

/// The mean of the descriptors so far, with the reference's mean as a prior.
class RunningMean {
 public:
  static constexpr double kPrior = 20;  ///< so many frames' weight the reference's mean has
  explicit RunningMean(const Eigen::VectorXf& reference) : sum_(kPrior * reference.cast<double>()) {}
  /// Takes the next descriptor and returns it without the mean of all so far, its own included.
  Eigen::VectorXf centre(const Eigen::Ref<const Eigen::VectorXf>& descriptor);

 private:
  Eigen::VectorXd sum_;
  int count_ = 0;
};

/// Centring, PCA with (partial) whitening learned on a reference traversal, and length 1: from an encoder's descriptors
/// to features (Jegou & Chum, ECCV 2012). Immutable once made.
class Reduction {
 public:
  Reduction() = default;
  /// Learns from the D x F descriptors of the reference traversal, in the order of its frames. Throws Error when the
  /// dimension is not 0..largest_dimension(D, F); logs a warning when it is more than half of F - 1 and the whitening
  /// is full (0.5), because the last components are noise then.
  static Reduction learn(Eigen::MatrixXf reference, const ReductionOptions& options);
  /// The most frames that it learns from; of a reference with more, as many that are evenly spread.
  static constexpr int kMaxSample = 4096;
  /// Returns the largest dimension that `frames` descriptors of `numbers` numbers allow.
  static int largest_dimension(Eigen::Index numbers, Eigen::Index frames) {
    return static_cast<int>(std::min(numbers, std::min<Eigen::Index>(frames, kMaxSample) - 1));
  }

  /// Turns D x n descriptors of a traversal's first frames, in order, into d x n features of length 1 (a descriptor
  /// equal to the mean becomes zeros), unless options().keeps_all(). With kOwn it needs the whole traversal.
  Eigen::MatrixXf apply(const Eigen::Ref<const Eigen::MatrixXf>& descriptors) const;
  /// Fills in the descriptors of frame `first` and those that follow it.
  using ReadBlock = std::function<void(Eigen::Index first, Eigen::Ref<Eigen::MatrixXf> descriptors)>;
  /// Does the same with descriptors that `read` fills in, kMaxSample at a time; for kOwn it reads all twice.
  Eigen::MatrixXf apply(Eigen::Index frames, const ReadBlock& read) const;
  /// Turns descriptors whose means have been subtracted into features.
  Eigen::MatrixXf project(const Eigen::Ref<const Eigen::MatrixXf>& centred) const;

  /// Throws Error when it was learned on descriptors of another number of numbers.
  void check_input(Eigen::Index numbers) const;
  int input_dimension() const { return static_cast<int>(mean_.size()); }
  int dimension() const;
  const ReductionOptions& options() const { return options_; }
  const Eigen::VectorXf& mean() const { return mean_; }  ///< D, of the reference; zeros without centring

  /// Returns its bytes, with the name of the encoder whose descriptors it was learned on. load() throws Error when the
  /// bytes are something else or belong to another encoder.
  Bytes save(const std::string& encoder) const;
  static Reduction load(std::span<const std::byte> bytes, const std::string& encoder, const std::string& where);

 private:
  ReductionOptions options_;
  Eigen::VectorXf mean_;
  Eigen::MatrixXf projection_;
};

/// Reduces the descriptors of a traversal one by one, in order, as Reduction::apply() does all of them. Not for
/// Centring::kOwn, which needs the whole traversal.
class OnlineReduction {
 public:
  explicit OnlineReduction(std::shared_ptr<const Reduction> reduction);
  /// Turns the next descriptor, D numbers, into d features.
  Eigen::VectorXf apply(const Eigen::Ref<const Eigen::VectorXf>& descriptor);

 private:
  const std::shared_ptr<const Reduction> reduction_;
  RunningMean mean_;
};

}  // namespace citylearn
