// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string>

#include "core/files/exif.h"

namespace citylearn {

/// Pictures with more pixels are refused when their header is read, before anything is allocated.
inline constexpr long kMaxPixels = 64L << 20;
/// Bytes of the largest image file.
inline constexpr std::size_t kMaxImageBytes = std::size_t{64} << 20;

/// Format and size of an image file, from its first bytes.
struct ImageHeader {
  std::string format;         ///< "jpeg", "png", "pnm", "bmp"
  int width = 0, height = 0;  ///< as the pixels lie
  int orientation = 0;        ///< of a JPEG's EXIF data, 1..8; 0: not told
};

/// Reads width and height from the beginning of a JPEG, PNG, PNM (P1..P6) or BMP file. Throws Error naming `where`:
/// another format, a cut or wrong header, a side of 0, more than kMaxPixels. `bytes` may be the whole file or at least
/// its first 64 KiB (a JPEG's size may stand far behind its thumbnails: then the whole file is needed).
ImageHeader read_image_header(std::span<const std::byte> bytes, const std::string& where);

/// Returns the EXIF data of a JPEG or PNG file, from its first bytes (72 KiB have those of a JPEG) and its last ones,
/// in which a PNG may have them too; these bytes must outlive the result. It tells nothing where there are none.
Exif exif_of(std::span<const std::byte> head, std::span<const std::byte> tail);

/// Returns why a whole image file is broken, as far as its structure shows without decoding it (an unreadable header,
/// a JPEG without its end marker, a PNG without IEND); nothing when it looks complete.
std::optional<std::string> image_fault(std::span<const std::byte> file);
/// Does the same with a file's first bytes (as many as read_image_header() needs) and its last ones, 4 KiB or more.
std::optional<std::string> image_fault(std::span<const std::byte> head, std::span<const std::byte> tail);

/// Decodes a JPEG file to height rows of 3 * width bytes, BGR, with the library that OpenCV calls too: OpenCV takes as
/// long again to swap the channels, and fills what is damaged with grey without a word. Returns false where it leaves
/// the file to OpenCV: other formats and colours. Throws Error naming `where` when data are damaged or missing; a few
/// surplus bytes, which cameras write, are not damage.
bool decode_jpeg(std::span<const std::byte> file, const ImageHeader& header, const std::string& where,
                 unsigned char* pixels);

}  // namespace citylearn
