// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "env_service/images/images.h"

namespace citylearn::testing {

/// Pictures "f0", "f1" and so on, of one byte each and without faults. A test overrides what it is about.
class FakeImages : public Images {
 public:
  explicit FakeImages(int frames) : frames_(frames) {}
  int frames() const override { return frames_; }
  void read(int frame, Bytes& bytes) override { bytes.assign(1, std::byte(frame)); }
  std::string name(int frame) const override { return "f" + std::to_string(frame); }
  std::uint64_t fingerprint(int frame) const override { return static_cast<std::uint64_t>(frame); }
  std::string fault(int) const override { return ""; }

 private:
  int frames_;
};

}  // namespace citylearn::testing
