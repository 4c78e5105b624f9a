// SPDX-License-Identifier: Apache-2.0
#include "core/files/exif.h"

#include <algorithm>
#include <iterator>
#include <limits>

namespace citylearn {
namespace {

// Types of values (CIPA DC-008, 4.6.2): bytes, text, 16-bit and 32-bit numbers, rationals; others are not read.
constexpr std::size_t kAscii = 2, kLong = 4;
constexpr std::size_t kBytesOf[] = {0, 1, 1, 2, 4, 8};
constexpr std::size_t kMaxNumbers = 8;

std::size_t bytes_of(std::size_t type) { return type < std::size(kBytesOf) ? kBytesOf[type] : 0; }

}  // namespace

std::size_t Exif::number(std::size_t at, std::size_t size) const {
  if (at > tiff_.size() || size > tiff_.size() - at) return 0;
  const bool little = tiff_[0] == std::byte{'I'};
  std::size_t value = 0;
  for (std::size_t i = 0; i < size; ++i)
    value = value << 8 | std::to_integer<std::size_t>(tiff_[little ? at + size - 1 - i : at + i]);
  return value;
}

Exif::Field Exif::field(Directory directory, unsigned tag) const {
  std::size_t at = number(4, 4);
  if (directory != Directory::kImage) {
    const Field pointer = field(Directory::kImage, directory == Directory::kPhoto ? 0x8769 : 0x8825);
    if (pointer.type != kLong) return {};
    at = number(pointer.at, 4);
  }
  const std::size_t fields = at == 0 ? 0 : number(at, 2);
  for (std::size_t entry = at + 2; entry < at + 2 + 12 * fields; entry += 12) {
    if (number(entry, 2) != tag) continue;
    const std::size_t type = number(entry + 2, 2), count = number(entry + 4, 4), size = count * bytes_of(type);
    if (size == 0) return {};
    const std::size_t values = size <= 4 ? entry + 8 : number(entry + 8, 4);
    if (values > tiff_.size() || size > tiff_.size() - values) return {};
    return {type, count, values};
  }
  return {};
}

std::vector<double> Exif::numbers(Directory directory, unsigned tag) const {
  const Field found = field(directory, tag);
  std::vector<double> numbers;
  for (std::size_t i = 0; i < std::min(found.count, kMaxNumbers); ++i) {
    const std::size_t size = bytes_of(found.type), at = found.at + i * size;
    if (size < 8) {
      numbers.push_back(static_cast<double>(number(at, size)));
      continue;
    }
    const auto above = static_cast<double>(number(at, 4)), below = static_cast<double>(number(at + 4, 4));
    numbers.push_back(below == 0 ? std::numeric_limits<double>::quiet_NaN() : above / below);
  }
  return numbers;
}

std::string Exif::text(Directory directory, unsigned tag) const {
  const Field found = field(directory, tag);
  if (found.type != kAscii) return "";
  std::string text(reinterpret_cast<const char*>(tiff_.data() + found.at), found.count);
  text.erase(std::min(text.find('\0'), text.size()));
  text.erase(text.find_last_not_of(' ') + 1);
  return text;
}

int Exif::orientation() const {
  const std::vector<double> told = numbers(Directory::kImage, 0x0112);
  return told.empty() || !(told[0] >= 1 && told[0] <= 8) ? 1 : static_cast<int>(told[0]);
}

}  // namespace citylearn
