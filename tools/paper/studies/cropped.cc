// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/studies/cropped.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "core/util/error.h"
#include "core/util/random.h"
#include "encoder_service/encoding/encoder.h"

namespace citylearn::paper {
namespace {

class Cropped : public Images {
 public:
  Cropped(std::shared_ptr<Images> pictures, double left, double width)
      : pictures_(std::move(pictures)), left_(left), width_(width) {
    if (!(left >= 0 && width > 0 && left + width <= 1))
      throw Error("a part from " + std::to_string(left) + ", " + std::to_string(width) + " wide, is not inside",
                  "crop");
  }

  int frames() const override { return pictures_->frames(); }

  void read(int frame, Bytes& bytes) override {
    pictures_->read(frame, whole_);
    const cv::Mat picture = decode_picture(whole_, pictures_->name(frame));
    const auto pixels = [&picture](double share) { return static_cast<int>(std::lround(share * picture.cols)); };
    const int width = std::max(1, pixels(width_)), left = std::min(pixels(left_), picture.cols - width);
    cv::imencode(".png", picture(cv::Rect(left, 0, width, picture.rows)), file_);
    bytes.resize(file_.size());
    std::memcpy(bytes.data(), file_.data(), file_.size());
  }

  std::string name(int frame) const override { return pictures_->name(frame) + ", cropped"; }
  std::uint64_t fingerprint(int frame) const override {
    return mix_seeds(
        {pictures_->fingerprint(frame), std::bit_cast<std::uint64_t>(left_), std::bit_cast<std::uint64_t>(width_)});
  }
  std::string fault(int frame) const override { return pictures_->fault(frame); }

 private:
  const std::shared_ptr<Images> pictures_;
  const double left_, width_;
  Bytes whole_;
  std::vector<unsigned char> file_;
};

}  // namespace

std::shared_ptr<Images> cropped(std::shared_ptr<Images> pictures, double left, double width) {
  return std::make_shared<Cropped>(std::move(pictures), left, width);
}

}  // namespace citylearn::paper
