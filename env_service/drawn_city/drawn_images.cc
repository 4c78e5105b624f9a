// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/drawn_images.h"

#include <bit>
#include <cmath>
#include <cstring>
#include <opencv2/imgcodecs.hpp>

#include "core/util/error.h"
#include "env_service/drawn_city/camera.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kVersion = 1;  // one more whenever pictures change

/// Returns one number that differs between drives.
std::uint64_t recipe(const DrawnOptions& options, std::uint64_t look) {
  return mix_seeds({kVersion, options.seed, look, static_cast<std::uint64_t>(options.width),
                    static_cast<std::uint64_t>(options.height), std::bit_cast<std::uint64_t>(options.countryside),
                    std::bit_cast<std::uint64_t>(options.viewpoint)});
}

class DrawnImages : public Images {
 public:
  DrawnImages(const DrawnOptions& options, drawn::Look look, std::uint64_t index, std::vector<float> positions)
      : options_(options), look_(std::move(look)), index_(index), positions_(std::move(positions)) {}

  int frames() const override { return static_cast<int>(positions_.size()); }

  void read(int frame, Bytes& bytes) override {
    // The camera paints its textures first, which need not happen where no picture is read.
    if (!camera_) camera_ = std::make_unique<drawn::Camera>(options_, look_, index_);
    const cv::Mat& picture = camera_->draw(positions_.at(static_cast<std::size_t>(frame)));
    try {
      cv::imencode(".png", picture, file_,
                   {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_STRATEGY, cv::IMWRITE_PNG_STRATEGY_RLE});
    } catch (const cv::Exception& error) {
      throw Error(error.err, name(frame));
    }
    bytes.resize(file_.size());
    std::memcpy(bytes.data(), file_.data(), file_.size());
  }

  std::string name(int frame) const override { return look_.name + ", frame " + std::to_string(frame); }
  std::uint64_t fingerprint(int frame) const override {
    const auto position = std::bit_cast<std::uint32_t>(positions_.at(static_cast<std::size_t>(frame)));
    return mix_seeds({recipe(options_, index_), position});
  }
  std::string fault(int) const override { return {}; }

 private:
  const DrawnOptions options_;
  const drawn::Look look_;
  const std::uint64_t index_;
  const std::vector<float> positions_;
  std::unique_ptr<drawn::Camera> camera_;
  std::vector<unsigned char> file_;
};

}  // namespace

const std::vector<std::string>& drawn_names() {
  static const std::vector<std::string> names = [] {
    std::vector<std::string> all;
    for (const drawn::Look& look : drawn::looks()) all.push_back(look.name);
    return all;
  }();
  return names;
}

std::shared_ptr<Images> drawn_images(const DrawnOptions& options, const std::string& name,
                                     std::vector<float> positions) {
  for (std::size_t index = 0; index < drawn::looks().size(); ++index) {
    drawn::Look look = drawn::looks()[index];
    if (look.name != name) continue;
    if (name == "shifted") look.lateral -= static_cast<float>(options.viewpoint);
    return std::make_shared<DrawnImages>(options, std::move(look), index, std::move(positions));
  }
  throw Error("draws no '" + name + "'", "synthetic images");
}

}  // namespace citylearn
