// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/dds/middleware.h"
#include "dashboard/live/picture_cache.h"

namespace citylearn {

/// Converts an image file (JPEG, PNG, PNM, BMP) to one that a browser shows: returns a JPEG or PNG of at most `widest`
/// pixels and 256 KiB unchanged, anything else as a JPEG of at most that width. Throws Error, naming `where`, when it
/// is not a picture.
PictureFile shrink(const Bytes& file, int widest, const std::string& where);

}  // namespace citylearn
