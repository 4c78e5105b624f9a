// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "encoder_service/encoding/picture_encoder.h"

namespace citylearn {
namespace {

/// Makes the encoder `name` with its default parameters.
std::unique_ptr<Encoder> with_defaults(const std::string& name) {
  const auto& entry = EncoderRegistry::instance().find("encoder", name);
  return entry.create(Parameters(name, entry.parameters, {}), {});
}

/// hog and vlad side by side, each of length 1 and weighed, so that the cosine of two descriptors is the weighted mean
/// of hog's and vlad's cosines. One of them sees what the other misses.
class HogVlad final : public Encoder {
 public:
  explicit HogVlad(const Parameters& parameters)
      : name_(encoder_name("hog_vlad-1", parameters)), share_(parameters["vlad-share"]) {}

  Spec spec() const override {
    const Spec hog = hog_->spec(), vlad = vlad_->spec();
    return {name_ + " of " + hog.name + ", " + vlad.name, hog.dimension + vlad.dimension, hog.batch};
  }

  Eigen::MatrixXf encode(std::span<const cv::Mat> pictures) override {
    Eigen::MatrixXf hog = hog_->encode(pictures), vlad = vlad_->encode(pictures);
    for (auto column : hog.colwise())  // vlad's are of length 1 already
      if (const float length = column.norm(); length > 0) column /= length;
    Eigen::MatrixXf both(hog.rows() + vlad.rows(), hog.cols());
    both << static_cast<float>(std::sqrt(1 - share_)) * hog, static_cast<float>(std::sqrt(share_)) * vlad;
    return both;
  }

  int training_sample_count() const override { return vlad_->training_sample_count(); }
  void learn(std::span<const cv::Mat> pictures) override { vlad_->learn(pictures); }
  Bytes state() const override { return vlad_->state(); }
  void restore(std::span<const std::byte> state) override { vlad_->restore(state); }

 private:
  std::string name_;
  double share_;  // of vlad's cosine in the joint one
  std::unique_ptr<Encoder> hog_ = with_defaults("hog"), vlad_ = with_defaults("vlad");
};

const EncoderRegistry::Registration hog_vlad_registration({
    .name = "hog_vlad",
    .help = "hog and vlad joined: where season and viewpoint change, or when unsure",
    .parameters = {{"vlad-share", "weight of vlad's cosine; hog's has the rest", 0.2, 0, 1}},
    .create = make_encoder<HogVlad>,
});

}  // namespace
}  // namespace citylearn
