// SPDX-License-Identifier: Apache-2.0
#include <opencv2/core.hpp>

#include "core/files/image_header.h"
#include "encoder_service/encoding/encoder.h"
#include "env_service/images/image_sources.h"
#include "tests/fuzz/targets.h"

namespace citylearn::fuzz {

bool picture(Input input) {
  // Large ones are slow to decode and no different; the limit itself has its unit tests.
  constexpr std::int64_t kPixels = 2 << 20;
  bool decodable = false;
  const bool readable = accepted([&] {
    const ImageHeader header = read_image_header(input, "picture");
    require(header.width > 0 && header.height > 0, "sides");
    require(std::int64_t{header.width} * header.height <= kMaxPixels, "too many pixels");
    decodable = std::int64_t{header.width} * header.height <= kPixels;
  });
  require(readable || image_fault(input).has_value(), "an unreadable header is a fault");
  if (!decodable && readable) return true;
  const bool decoded = accepted([&] {
    const cv::Mat picture = decode_picture(input, "picture");
    require(picture.type() == CV_8UC3, "8-bit BGR");
    const ImageHeader header = read_image_header(input, "picture");
    require(picture.cols == header.width && picture.rows == header.height, "the header's sides");
  });
  require(readable || !decoded, "only what has a header is decoded");
  // The datasets' own decoder also refuses files without an end.
  accepted([&] {
    const cv::Mat other = decode_image(Bytes(input.begin(), input.end()), "picture");
    require(decoded && !image_fault(input).has_value(), "both decoders agree");
    require(other.size() == decode_picture(input, "picture").size(), "both decoders agree on the sides");
  });
  return decoded;
}

}  // namespace citylearn::fuzz
