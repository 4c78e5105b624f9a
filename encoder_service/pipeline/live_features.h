// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <memory>

#include "encoder_service/encoding/reduction.h"

namespace citylearn {

/// Features of a robot's pictures, made one by one as pictures come. The newest are kept. Used by one thread.
class LiveFeatures {
 public:
  /// `reduction`: what was learned by these options; null: nothing was, and features are the descriptors, of `numbers`
  /// numbers. Throws Error when it needs the whole traversal (Centring::kOwn).
  LiveFeatures(const ReductionOptions& options, std::shared_ptr<const Reduction> reduction, int numbers);

  /// d, of each picture's features.
  int dimension() const { return dimension_; }
  void put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor);
  /// Gives a frame that cannot be encoded the features of the one before it; zeros where there is none.
  void put_bad(int frame);
  /// Returns the d features; null when they are not here.
  const float* find(int frame) const;

 private:
  static constexpr std::size_t kMaxPictures = 256;  // pictures

  void keep(int frame);

  const int dimension_;
  std::unique_ptr<OnlineReduction> reduction_;
  Eigen::VectorXf last_;
  std::map<int, Eigen::VectorXf> features_;  // by frame
};

}  // namespace citylearn
