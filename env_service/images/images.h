// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/util/types.h"

namespace citylearn {

/// The pictures of a recording, one a frame. Each is read when it is needed, so a long recording costs no memory. Used
/// by one thread at a time.
class Images {
 public:
  virtual ~Images() = default;
  /// Returns F.
  virtual int frames() const = 0;
  /// Reads the frame's image file (JPEG, PNG, PNM or BMP) into `bytes`, whose capacity is reused. Throws Error naming
  /// the frame when it cannot be read.
  virtual void read(int frame, Bytes& bytes) = 0;
  /// Returns a name for messages: "summer/images-00010.png", "drive.mp4, frame 12".
  virtual std::string name(int frame) const = 0;
  /// Returns a number that identifies the picture without decoding it; the same on every machine.
  virtual std::uint64_t fingerprint(int frame) const = 0;
  /// Returns why the frame is missing or broken, as far as can be seen without decoding it; empty when it seems fine.
  virtual std::string fault(int frame) const = 0;
};

/// Pictures made from others, which differ from them in what a derived class overrides.
class DerivedImages : public Images {
 public:
  explicit DerivedImages(std::shared_ptr<Images> images) : images_(std::move(images)) {}
  int frames() const override { return images_->frames(); }
  void read(int frame, Bytes& bytes) override { images_->read(frame, bytes); }
  std::string name(int frame) const override { return images_->name(frame); }
  std::uint64_t fingerprint(int frame) const override { return images_->fingerprint(frame); }
  std::string fault(int frame) const override { return images_->fault(frame); }

 protected:
  const std::shared_ptr<Images> images_;
};

}  // namespace citylearn
