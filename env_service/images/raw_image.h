// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// Pixels as a camera sends them, row by row.
struct RawImage {
  std::uint32_t width = 0, height = 0;
  std::uint32_t step = 0;  ///< bytes from one row to the next
  std::string encoding;    ///< as in ROS 2's sensor_msgs/image_encodings.hpp: rgb8, bayer_rggb8, yuv422, 16UC1 ...
  std::span<const std::uint8_t> data;
  bool is_bigendian = false;  ///< of numbers of 16 bits
};

/// Returns what is wrong with a picture, as "has encoding 'x'"; empty when nothing is.
std::string raw_fault(const RawImage& image);
/// Writes a picture as a PNG file of 8 bits: of numbers of 16 bits the high byte. Returns likewise what is wrong
/// with it.
std::string encode_raw(const RawImage& image, Bytes& file);

}  // namespace citylearn
