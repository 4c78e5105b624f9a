// SPDX-License-Identifier: Apache-2.0
#include <opencv2/imgproc.hpp>
#include <optional>

#include "encoder_service/encoding/picture_encoder.h"
#include "encoder_service/encoding/reduction.h"
#include "encoder_service/encoding/sliding_normalisation.h"

namespace citylearn {
namespace {

constexpr int kSide = 84;          // pixels
constexpr double kDeviations = 6;  // from black to white, where contrast is normalised

/// The pixels, 84 x 84 in colour from 0 to 1, row by row, red, green, blue: what end-to-end agents look at (CityLearn's
/// baseline after Mirowski et al., NeurIPS 2018).
class Raw84 final : public PictureEncoder {
 public:
  explicit Raw84(const Parameters& parameters) : name_(encoder_name("raw84-2", parameters)) {
    if (parameters["sigma"] > 0) normalisation_.emplace(cv::Size(kSide, kSide), parameters["sigma"]);
  }
  Spec spec() const override { return {name_, kSide * kSide * 3, batch()}; }

 private:
  void describe(const cv::Mat& picture, Eigen::Ref<Eigen::VectorXf> descriptor) const override {
    cv::Mat colours, pixels(kSide, kSide, CV_32FC3, descriptor.data());
    cv::cvtColor(scaled(picture, kSide, kSide), colours, cv::COLOR_BGR2RGB);
    colours.convertTo(pixels, CV_32F, 1 / 255.0);
    if (!normalisation_) return;
    colours.convertTo(colours, CV_32F);
    normalisation_->apply(colours).convertTo(pixels, CV_32F, 1 / kDeviations, 0.5);
    cv::min(cv::max(pixels, cv::Scalar::all(0)), cv::Scalar::all(1), pixels);
  }

  std::string name_;
  std::optional<SlidingNormalisation> normalisation_;
};

const EncoderRegistry::Registration raw84_registration({
    .name = "raw84",
    .help = "the pixels, 84 x 84 x 3: for networks that learn their own features",
    .parameters = {{"sigma",
                    "of the Gaussian window, pixels, whose mean is taken from each colour and over whose deviation it "
                    "is divided, so that light and season change less; 0: colours as they are",
                    4, 0, 84}},
    .create = make_encoder<Raw84>,
    // A network that learns to see learns nothing from pixels of which PCA keeps some, or that are scaled to length 1.
    .recommended = {{"dimension", 0}, {"centring", static_cast<double>(Centring::kNone)}},
});

}  // namespace
}  // namespace citylearn
