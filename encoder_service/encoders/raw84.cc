// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgproc.hpp>

#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {
namespace {

constexpr int kSide = 84;  // pixels

/// The pixels themselves, 84 x 84 in colour from 0 to 1, row by row, red, green, blue: what end-to-end agents look at
/// (CityLearn's baseline after Mirowski et al., NeurIPS 2018).
class Raw84 final : public PictureEncoder {
 public:
  explicit Raw84(const Parameters&) {}
  Spec spec() const override { return {"raw84-1", kSide * kSide * 3, 16}; }

 private:
  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) override {
    cv::Mat colours, pixels(kSide, kSide, CV_32FC3, descriptor.data());
    cv::cvtColor(scaled(picture, kSide, kSide), colours, cv::COLOR_BGR2RGB);
    colours.convertTo(pixels, CV_32F, 1 / 255.0);
  }
};

const EncoderRegistry::Registration raw84_registration({
    .name = "raw84",
    .help = "the pixels, 84 x 84 x 3: for networks that learn their own features",
    .parameters = {},
    .create = make_encoder<Raw84>,
});

}  // namespace
}  // namespace citylearn
