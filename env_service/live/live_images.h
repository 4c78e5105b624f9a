// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <deque>
#include <memory>
#include <string>
#include <utility>

#include "env_service/images/images.h"

namespace citylearn {

/// The pictures of a route that was taught, and behind them those that a robot's camera takes, in the order in which
/// they come. Of the latter the newest are kept.
class LiveImages : public DerivedImages {
 public:
  /// `name`: of what the robot sees, for messages. `session`: a number of its own for each robot and start, so that
  /// nobody takes its pictures for those of another.
  LiveImages(std::shared_ptr<Images> taught, std::string name, std::uint64_t session)
      : DerivedImages(std::move(taught)), name_(std::move(name)), session_(session) {}

  /// Adds a picture's file and returns its frame.
  int add(const Bytes& file);

  int frames() const override { return images_->frames() + dropped_ + static_cast<int>(live_.size()); }
  /// Throws Error too when the picture is no longer kept.
  void read(int frame, Bytes& bytes) override;
  std::string name(int frame) const override;
  std::uint64_t fingerprint(int frame) const override;
  std::string fault(int frame) const override { return is_live(frame) ? "" : DerivedImages::fault(frame); }

 private:
  static constexpr std::size_t kMaxPictures = 256;  // pictures

  bool is_live(int frame) const { return frame >= images_->frames(); }

  const std::string name_;
  const std::uint64_t session_;
  std::deque<Bytes> live_;
  int dropped_ = 0;
};

}  // namespace citylearn
