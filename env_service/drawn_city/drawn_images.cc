// SPDX-License-Identifier: Apache-2.0
#include "env_service/drawn_city/drawn_images.h"

#include <bit>
#include <cstring>
#include <opencv2/imgcodecs.hpp>
#include <utility>

#include "core/util/error.h"
#include "core/util/text.h"
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

/// Returns the look with this name, and its index. Throws Error when there is none.
std::pair<drawn::Look, std::uint64_t> find_look(const DrawnOptions& options, const std::string& name) {
  for (std::size_t index = 0; index < drawn::looks().size(); ++index) {
    drawn::Look look = drawn::looks()[index];
    if (look.name != name) continue;
    if (name == "shifted") look.lateral -= static_cast<float>(options.viewpoint);
    return {look, index};
  }
  throw Error("draws no '" + name + "'", "synthetic images", "there are: " + joined(drawn_names()));
}

class DrawnImages : public Images {
 public:
  DrawnImages(const DrawnOptions& options, const std::string& name, std::uint64_t recipe, std::vector<float> positions)
      : options_(options), name_(name), recipe_(recipe), positions_(std::move(positions)) {}

  int frames() const override { return static_cast<int>(positions_.size()); }

  void read(int frame, Bytes& bytes) override {
    // The camera paints its textures first, which need not happen where no picture is read.
    if (!drive_) drive_ = std::make_unique<DrawnDrive>(options_, name_);
    drive_->draw(positions_.at(static_cast<std::size_t>(frame)), bytes);
  }

  std::string name(int frame) const override { return name_ + ", frame " + std::to_string(frame); }
  std::uint64_t fingerprint(int frame) const override {
    const auto position = std::bit_cast<std::uint32_t>(positions_.at(static_cast<std::size_t>(frame)));
    return mix_seeds({recipe_, position});
  }
  std::string fault(int) const override { return {}; }

 private:
  const DrawnOptions options_;
  const std::string name_;
  const std::uint64_t recipe_;
  const std::vector<float> positions_;
  std::unique_ptr<DrawnDrive> drive_;
};

}  // namespace

struct DrawnDrive::Impl {
  Impl(const DrawnOptions& options, const std::pair<drawn::Look, std::uint64_t>& found)
      : look(found.first), camera(options, look, found.second) {}

  const drawn::Look look;
  drawn::Camera camera;
  std::vector<unsigned char> file;
};

DrawnDrive::DrawnDrive(const DrawnOptions& options, const std::string& name)
    : impl_(std::make_unique<Impl>(options, find_look(options, name))) {}

DrawnDrive::~DrawnDrive() = default;

void DrawnDrive::draw(float metres, Bytes& file) {
  std::vector<unsigned char>& bytes = impl_->file;
  try {
    cv::imencode(".png", impl_->camera.draw(metres), bytes,
                 {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_STRATEGY, cv::IMWRITE_PNG_STRATEGY_RLE});
  } catch (const cv::Exception& error) {
    throw Error(error.err, impl_->look.name + ", at " + std::to_string(metres) + " m");
  }
  file.resize(bytes.size());
  std::memcpy(file.data(), bytes.data(), bytes.size());
}

float DrawnDrive::heading(float metres) const { return impl_->camera.heading(metres); }

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
  const auto [look, index] = find_look(options, name);
  return std::make_shared<DrawnImages>(options, name, recipe(options, index), std::move(positions));
}

}  // namespace citylearn
