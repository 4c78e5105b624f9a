// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>

namespace citylearn {

// Frames (docs/reference/dashboard-api.md, "WebSocket"): 4 bytes with the header's length, little-endian, the header,
// which is JSON, and a payload that begins at a multiple of 8.

/// Returns the length, the header, and spaces up to where the payload begins.
inline std::string frame_head(const std::string& json) {
  const std::size_t length = (json.size() + 4 + 7) / 8 * 8 - 4;
  std::string head;
  head.reserve(length + 4);
  for (int byte = 0; byte < 4; ++byte) head += static_cast<char>(length >> (8 * byte) & 0xFF);
  head += json;
  head.resize(length + 4, ' ');
  return head;
}

/// Returns header and payload of a frame, or nothing when it is cut short.
inline std::optional<std::pair<std::string_view, std::string_view>> split_frame(std::string_view frame) {
  if (frame.size() < 4) return std::nullopt;
  std::size_t length = 0;
  for (int byte = 0; byte < 4; ++byte)
    length += std::size_t{static_cast<unsigned char>(frame[static_cast<std::size_t>(byte)])} << (8 * byte);
  frame.remove_prefix(4);
  if (length > frame.size()) return std::nullopt;
  return std::pair(frame.substr(0, length), frame.substr(length));
}

}  // namespace citylearn
