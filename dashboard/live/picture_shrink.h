// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/dds/middleware.h"
#include "dashboard/live/picture_cache.h"

namespace citylearn {

struct PictureLimits {
  int widest = 640;                            ///< pixels
  std::size_t bytes = std::size_t{256} << 10;  ///< of a file that needs no conversion
};

/// Converts an image file (JPEG, PNG, PNM, BMP) to one that a browser shows: returns a JPEG or PNG within the limits
/// unchanged, anything else as a JPEG of at most that width. Throws Error, naming `where`, when it is not a picture.
PictureFile shrink(const Bytes& file, const PictureLimits& limits, const std::string& where);

}  // namespace citylearn
