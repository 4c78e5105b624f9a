// SPDX-License-Identifier: Apache-2.0
#include "encoder_service/pipeline/live_features.h"

#include <utility>

#include "core/util/error.h"

namespace citylearn {

LiveFeatures::LiveFeatures(const ReductionOptions& options, std::shared_ptr<const Reduction> reduction, int numbers)
    : dimension_(reduction ? reduction->dimension() : numbers), last_(Eigen::VectorXf::Zero(dimension_)) {
  if (options.centring == Centring::kOwn)
    throw Error("needs the whole traversal before the first picture", "--centring own", "give running or reference");
  if (reduction) reduction_ = std::make_unique<OnlineReduction>(std::move(reduction));
}

void LiveFeatures::put(int frame, const Eigen::Ref<const Eigen::VectorXf>& descriptor) {
  last_ = reduction_ ? reduction_->apply(descriptor) : Eigen::VectorXf(descriptor);
  keep(frame);
}

void LiveFeatures::put_bad(int frame) { keep(frame); }

void LiveFeatures::keep(int frame) {
  features_[frame] = last_;
  if (features_.size() > kMaxPictures) features_.erase(features_.begin());
}

const float* LiveFeatures::find(int frame) const {
  const auto found = features_.find(frame);
  return found == features_.end() ? nullptr : found->second.data();
}

}  // namespace citylearn
