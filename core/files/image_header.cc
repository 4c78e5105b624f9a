// SPDX-License-Identifier: Apache-2.0
#include "core/files/image_header.h"

#include <algorithm>
#include <cstdint>
#include <string_view>

#include "core/util/error.h"

namespace citylearn {
namespace {

using namespace std::string_view_literals;

std::string_view text_of(std::span<const std::byte> bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}

/// Bytes with a place to read from; every read checks that it stays inside.
class Cursor {
 public:
  Cursor(std::span<const std::byte> bytes, const std::string& where) : bytes_(bytes), where_(where) {}

  [[noreturn]] void fail(const std::string& what) const { throw Error(what, where_); }
  std::uint32_t byte() { return std::to_integer<std::uint32_t>(take(1)[0]); }
  std::uint32_t big16() {
    const std::uint32_t high = byte();
    return high << 8 | byte();
  }
  std::uint32_t big32() {
    const std::uint32_t high = big16();
    return high << 16 | big16();
  }
  std::uint32_t little32() {
    std::uint32_t number = 0;
    for (int shift = 0; shift < 32; shift += 8) number |= byte() << shift;
    return number;
  }
  void skip(std::size_t count) { take(count); }
  std::span<const std::byte> take(std::size_t count) {
    if (count > bytes_.size() - at_) fail("the image file is cut short in its header");
    at_ += count;
    return bytes_.subspan(at_ - count, count);
  }
  bool begins(std::string_view text) const { return text_of(bytes_).starts_with(text); }
  /// A number in the text of a PNM header: blanks and comments go before it.
  std::uint64_t decimal() {
    std::uint32_t c = byte();
    while (c == '#' || c == ' ' || (c >= '\t' && c <= '\r')) {
      if (c == '#')
        while (c != '\n' && c != '\r') c = byte();
      c = byte();
    }
    std::uint64_t number = 0;
    if (c < '0' || c > '9') fail("a broken PNM header");
    for (; c >= '0' && c <= '9'; c = byte()) {
      number = number * 10 + (c - '0');
      if (number > 0xFFFFFFFF) fail("a broken PNM header");
    }
    return number;
  }

 private:
  std::span<const std::byte> bytes_;
  const std::string& where_;
  std::size_t at_ = 0;
};

/// The frame header (SOFn) among the segments of a JPEG file (ITU-T T.81, B.2), and the EXIF data in those before it.
void find_jpeg_size(Cursor& cursor, std::int64_t& width, std::int64_t& height, std::span<const std::byte>& exif) {
  cursor.skip(2);
  while (true) {
    std::uint32_t marker = cursor.byte();
    if (marker != 0xFF) cursor.fail("a broken JPEG header");
    while (marker == 0xFF) marker = cursor.byte();                       // fill bytes
    if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8)) continue;  // markers without a segment
    if (marker == 0xD9 || marker == 0xDA) cursor.fail("a JPEG file that tells no size before its data");
    const std::uint32_t length = cursor.big16();
    if (length < 2) cursor.fail("a broken JPEG header");
    const bool frame = marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) {
      cursor.skip(1);  // bits a sample
      height = cursor.big16();
      width = cursor.big16();
      return;
    }
    const std::span<const std::byte> segment = cursor.take(length - 2);
    if (marker == 0xE1 && exif.empty() && text_of(segment).starts_with("Exif\0\0"sv)) exif = segment.subspan(6);
  }
}

/// A blank follows the type: of other files that begin so, OpenCV thinks they could be DICOM, whose decoder crashes.
bool is_pnm(std::span<const std::byte> bytes) {
  if (bytes.size() < 3 || bytes[0] != std::byte{'P'} || bytes[1] < std::byte{'1'} || bytes[1] > std::byte{'6'})
    return false;
  return bytes[2] == std::byte{' '} || (bytes[2] >= std::byte{'\t'} && bytes[2] <= std::byte{'\r'});
}

bool ends_with(std::span<const std::byte> file, std::string_view text, std::size_t within) {
  return text_of(file.last(std::min(file.size(), within))).find(text) != std::string_view::npos;
}

}  // namespace

ImageHeader read_image_header(std::span<const std::byte> bytes, const std::string& where) {
  Cursor cursor(bytes, where);
  ImageHeader header;
  std::int64_t width = 0, height = 0;
  if (bytes.empty()) cursor.fail("an empty file");
  if (cursor.begins("\xFF\xD8\xFF"sv)) {
    header.format = "jpeg";
    std::span<const std::byte> exif;
    find_jpeg_size(cursor, width, height, exif);
    if (!exif.empty()) header.orientation = Exif(exif).orientation();
  } else if (cursor.begins("\x89PNG\r\n\x1A\n"sv)) {
    header.format = "png";
    cursor.skip(16);  // signature, length and name of IHDR
    width = cursor.big32();
    height = cursor.big32();
  } else if (cursor.begins("BM"sv)) {
    header.format = "bmp";
    cursor.skip(14);
    const std::uint32_t size = cursor.little32();
    if (size < 40) cursor.fail("a BMP file older than Windows 3");
    width = static_cast<std::int32_t>(cursor.little32());
    height = static_cast<std::int32_t>(cursor.little32());
    if (height < 0) height = -height;  // stored from the top
  } else if (is_pnm(bytes)) {
    header.format = "pnm";
    cursor.skip(2);
    width = static_cast<std::int64_t>(cursor.decimal());
    height = static_cast<std::int64_t>(cursor.decimal());
  } else {
    cursor.fail("neither a JPEG, PNG, PNM nor BMP file");
  }
  if (width < 1 || height < 1)
    cursor.fail("an image of " + std::to_string(width) + " x " + std::to_string(height) + " pixels");
  if (width > kMaxPixels / height)
    cursor.fail("an image of " + std::to_string(width) + " x " + std::to_string(height) + " pixels, at most " +
                std::to_string(kMaxPixels) + " are allowed");
  header.width = static_cast<int>(width);
  header.height = static_cast<int>(height);
  return header;
}

Exif exif_of(std::span<const std::byte> head, std::span<const std::byte> tail) {
  std::span<const std::byte> exif;
  if (const std::string where; text_of(head).starts_with("\xFF\xD8\xFF"sv)) try {
      Cursor cursor(head, where);
      std::int64_t width = 0, height = 0;
      find_jpeg_size(cursor, width, height, exif);
    } catch (const Error&) {  // the size comes behind `head`; EXIF data come first
    }
  if (text_of(head).starts_with("\x89PNG"sv))  // in a chunk before the pixels or behind them
    for (const std::span<const std::byte> end : {head, tail})
      for (const std::string_view begin : {"eXIfII*\0"sv, "eXIfMM\0*"sv})
        if (const std::size_t at = text_of(end).find(begin); at != std::string_view::npos && exif.empty())
          exif = end.subspan(at + 4);
  return Exif(exif);
}

std::optional<std::string> image_fault(std::span<const std::byte> file) { return image_fault(file, file); }

std::optional<std::string> image_fault(std::span<const std::byte> head, std::span<const std::byte> tail) {
  try {
    const std::string format = read_image_header(head, "").format;
    // Cameras pad JPEG files with zeros; 4 KiB of them are passed over.
    if (format == "jpeg" && !ends_with(tail, "\xFF\xD9"sv, 4096)) return "the JPEG file is cut short";
    if (format == "png" && !ends_with(tail, "IEND"sv, 64)) return "the PNG file is cut short";
  } catch (const Error& error) {
    return error.what();
  }
  return std::nullopt;
}

}  // namespace citylearn
