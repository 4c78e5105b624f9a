// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/simulated.h"

#include <Eigen/Core>
#include <algorithm>
#include <bit>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "core/util/random.h"
#include "encoder_service/encoding/encoder.h"
#include "env_service/images/image_sources.h"

namespace citylearn::paper {
namespace {

constexpr int kPatch = 16;  // frames
constexpr double kMinShare = 0.2;

class Cropped : public DerivedImages {
 public:
  Cropped(std::shared_ptr<Images> pictures, double left, double width)
      : DerivedImages(std::move(pictures)), left_(left), width_(width) {
    if (!(left >= 0 && width > 0 && left + width <= 1))
      throw Error("a part from " + std::to_string(left) + ", " + std::to_string(width) + " wide, is not inside",
                  "crop");
  }

  void read(int frame, Bytes& bytes) override {
    images_->read(frame, bytes);
    const cv::Mat picture = decode_picture(bytes, images_->name(frame));
    const auto pixels = [&picture](double share) { return static_cast<int>(std::lround(share * picture.cols)); };
    const int width = std::max(1, pixels(width_)), left = std::min(pixels(left_), picture.cols - width);
    encode_png(picture(cv::Rect(left, 0, width, picture.rows)), bytes);
  }

  std::string name(int frame) const override { return images_->name(frame) + ", cropped"; }
  std::uint64_t fingerprint(int frame) const override {
    return mix_seeds(
        {images_->fingerprint(frame), std::bit_cast<std::uint64_t>(left_), std::bit_cast<std::uint64_t>(width_)});
  }

 private:
  const double left_, width_;
};

class Mixed : public DerivedImages {
 public:
  Mixed(std::shared_ptr<Images> first, std::shared_ptr<Images> second)
      : DerivedImages(std::move(first)), second_(std::move(second)) {}

  int frames() const override { return std::min(images_->frames(), second_->frames()); }

  void read(int frame, Bytes& bytes) override {
    images_->read(frame, bytes);
    const cv::Mat one = decode_picture(bytes, images_->name(frame));
    second_->read(frame, bytes);
    cv::Mat other = decode_picture(bytes, second_->name(frame)), mixed;
    cv::resize(other, other, one.size(), 0, 0, cv::INTER_AREA);
    const double share = share_of_second(frame);
    cv::addWeighted(one, 1 - share, other, share, 0, mixed);
    encode_png(mixed, bytes);
  }

  std::string name(int frame) const override { return images_->name(frame) + " mixed with " + second_->name(frame); }
  std::uint64_t fingerprint(int frame) const override {
    return mix_seeds({images_->fingerprint(frame), second_->fingerprint(frame), static_cast<std::uint64_t>(frame)});
  }
  std::string fault(int frame) const override {
    const std::string fault = images_->fault(frame);
    return fault.empty() ? second_->fault(frame) : fault;
  }

 private:
  const std::shared_ptr<Images> second_;
};

}  // namespace

std::shared_ptr<Images> cropped(std::shared_ptr<Images> pictures, double left, double width) {
  return std::make_shared<Cropped>(std::move(pictures), left, width);
}

double share_of_second(int frame) {
  const auto draw = [](int patch) { return Random{0x6d6978, static_cast<std::uint64_t>(patch)}.uniform(); };
  const double past = static_cast<double>(frame % kPatch) / kPatch;
  const double drawn = (1 - past) * draw(frame / kPatch) + past * draw(frame / kPatch + 1);
  return kMinShare + (1 - 2 * kMinShare) * drawn;
}

Traversal mixture(const Traversal& first, const Traversal& second, const std::string& name) {
  Traversal mixed;
  mixed.dataset = first.dataset;
  mixed.name = mixed.condition = name;
  mixed.frames = std::min(first.frames, second.frames);
  mixed.positions.assign(first.positions.begin(), first.positions.begin() + mixed.frames);
  if (first.images && second.images) {
    mixed.images = std::make_shared<Mixed>(first.images, second.images);
    return mixed;
  }
  if (first.images || second.images || first.dimension != second.dimension)
    throw Error("have features of different kinds", "traversals '" + first.name + "' and '" + second.name + "'");
  mixed.dimension = first.dimension;
  const auto dimension = static_cast<std::size_t>(first.dimension);
  mixed.features.resize(static_cast<std::size_t>(mixed.frames) * dimension);
  for (int frame = 0; frame < mixed.frames; ++frame) {
    const std::size_t begin = static_cast<std::size_t>(frame) * dimension;
    const auto of = [&](const Traversal& traversal) {
      return Eigen::Map<const Eigen::VectorXf>(traversal.features.data() + begin, first.dimension);
    };
    const auto share = static_cast<float>(share_of_second(frame));
    Eigen::VectorXf sum = (1 - share) * of(first) + share * of(second);
    if (const float length = sum.norm(); length > 0)
      sum *= ((1 - share) * of(first).norm() + share * of(second).norm()) / length;
    std::copy(sum.begin(), sum.end(), mixed.features.begin() + static_cast<std::ptrdiff_t>(begin));
  }
  return mixed;
}

}  // namespace citylearn::paper
