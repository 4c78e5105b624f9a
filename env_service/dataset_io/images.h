// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// The pictures of a recording, one a frame, each read when it is asked for: a long recording costs no memory.
/// Used by one thread at a time.
class Images {
 public:
  virtual ~Images() = default;
  /// F.
  virtual int frames() const = 0;
  /// The frame's picture as the bytes of an image file (JPEG, PNG, PNM or BMP) into `bytes`, whose capacity is used
  /// again. Throws Error naming the frame when it can't be read.
  virtual void read(int frame, Bytes& bytes) = 0;
  /// For people: "summer/images-00010.png", "drive.mp4, frame 12".
  virtual std::string name(int frame) const = 0;
  /// Tells pictures apart without decoding them: other pictures, other numbers; the same on every machine.
  virtual std::uint64_t fingerprint(int frame) const = 0;
  /// Why the frame is missing or broken, as far as this was seen without decoding it; empty when it seems fine.
  virtual std::string fault(int frame) const = 0;
};

}  // namespace citylearn
