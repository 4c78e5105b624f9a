// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/mixture.h"

#include <Eigen/Core>
#include <algorithm>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "core/util/error.h"
#include "core/util/random.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn::paper {
namespace {

constexpr int kPatch = 16;  // frames
constexpr double kLeastShare = 0.2;

class Mixed : public Images {
 public:
  Mixed(std::shared_ptr<Images> first, std::shared_ptr<Images> second)
      : first_(std::move(first)), second_(std::move(second)) {}

  int frames() const override { return std::min(first_->frames(), second_->frames()); }

  void read(int frame, Bytes& bytes) override {
    first_->read(frame, whole_);
    const cv::Mat one = decode_picture(whole_, first_->name(frame));
    second_->read(frame, whole_);
    cv::Mat other = decode_picture(whole_, second_->name(frame)), mixed;
    cv::resize(other, other, one.size(), 0, 0, cv::INTER_AREA);
    const double share = share_of_second(frame);
    cv::addWeighted(one, 1 - share, other, share, 0, mixed);
    cv::imencode(".png", mixed, file_);
    bytes.resize(file_.size());
    std::memcpy(bytes.data(), file_.data(), file_.size());
  }

  std::string name(int frame) const override { return first_->name(frame) + " mixed with " + second_->name(frame); }
  std::uint64_t fingerprint(int frame) const override {
    return mix_seeds({first_->fingerprint(frame), second_->fingerprint(frame), static_cast<std::uint64_t>(frame)});
  }
  std::string fault(int frame) const override {
    const std::string fault = first_->fault(frame);
    return fault.empty() ? second_->fault(frame) : fault;
  }

 private:
  const std::shared_ptr<Images> first_, second_;
  Bytes whole_;
  std::vector<unsigned char> file_;
};

}  // namespace

double share_of_second(int frame) {
  const auto draw = [](int patch) { return Random{0x6d6978, static_cast<std::uint64_t>(patch)}.uniform(); };
  const double past = static_cast<double>(frame % kPatch) / kPatch;
  const double drawn = (1 - past) * draw(frame / kPatch) + past * draw(frame / kPatch + 1);
  return kLeastShare + (1 - 2 * kLeastShare) * drawn;
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
