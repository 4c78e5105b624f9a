// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <opencv2/core.hpp>

#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {
namespace {

/// SeqSLAM's image (Milford & Wyeth, ICRA 2012): grey, small, each patch minus its mean and over its deviation.
class PatchNorm final : public PictureEncoder {
 public:
  explicit PatchNorm(const Parameters& parameters)
      : name_(encoder_name("patchnorm-1", parameters)),
        width_(parameters.integer("width")),
        height_(parameters.integer("height")),
        patch_(parameters.integer("patch")) {}

  Spec spec() const override { return {name_, width_ * height_, batch()}; }

 private:
  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) const override {
    cv::Mat grey = scaled_grey(picture, width_, height_);
    for (int y = 0; y < height_; y += patch_)
      for (int x = 0; x < width_; x += patch_) {
        // Patches at the right and lower border may be smaller.
        cv::Mat patch = grey(cv::Rect(x, y, std::min(patch_, width_ - x), std::min(patch_, height_ - y)));
        cv::Scalar mean, deviation;
        cv::meanStdDev(patch, mean, deviation);
        // At least one grey level, so that noise in a flat patch is not blown up.
        const double scale = 1 / std::max(deviation[0], 1.0);
        patch.convertTo(patch, CV_32F, scale, -mean[0] * scale);
      }
    descriptor = Eigen::Map<const Eigen::VectorXf>(grey.ptr<float>(), descriptor.size());
  }

  std::string name_;
  int width_, height_, patch_;
};

const EncoderRegistry::Registration patchnorm_registration({
    .name = "patchnorm",
    .help = "patch-normalised pixels of SeqSLAM: the classic, for sequences of frames",
    .parameters = {{"width", "width of the scaled picture, pixels", 64, 1, 1024, true},
                   {"height", "height of the scaled picture, pixels", 32, 1, 1024, true},
                   {"patch", "side of a patch, pixels", 8, 2, 1024, true}},
    .create = make_encoder<PatchNorm>,
});

}  // namespace
}  // namespace citylearn
