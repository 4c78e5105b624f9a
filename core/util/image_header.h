// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

namespace citylearn {

/// Pictures with more pixels are refused by their header alone, before anything is allocated.
inline constexpr long kMaxPixels = 64L << 20;
/// Bytes of the largest image file.
inline constexpr std::size_t kMaxImageBytes = std::size_t{64} << 20;

/// What the first bytes of an image file say.
struct ImageHeader {
  std::string format;  ///< "jpeg", "png", "pnm", "bmp"
  int width = 0, height = 0;
};

/// Reads width and height from the beginning of a JPEG, PNG, PNM (P1..P6) or BMP file. Throws Error naming `where`:
/// another format, a cut or wrong header, a side of 0, more than kMaxPixels. `bytes` may be the whole file or at least
/// its first 64 KiB (a JPEG's size may stand far behind its thumbnails: then the whole file is needed).
ImageHeader read_image_header(std::span<const std::byte> bytes, const std::string& where);

/// Why a whole image file is certainly broken, as far as its structure tells without decoding it (an unreadable header,
/// a JPEG without its end marker, a PNG without IEND); nothing when it looks complete.
std::optional<std::string> image_fault(std::span<const std::byte> file);
/// The same from a file's first bytes (as read_image_header() wants them) and its last ones, 4 KiB or more.
std::optional<std::string> image_fault(std::span<const std::byte> head, std::span<const std::byte> tail);

}  // namespace citylearn
