// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <zlib.h>

#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "core/util/error.h"
#include "core/util/types.h"

namespace citylearn {

/// Returns the CRC-32 of bytes.
inline std::uint32_t checksum(std::span<const std::byte> bytes) {
  return static_cast<std::uint32_t>(::crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

/// Writes numbers as they lie in memory (only little-endian machines are supported), with a checksum at the end.
class ByteWriter {
 public:
  template <class T>
  void put(const T* values, std::size_t count) {
    const auto* first = reinterpret_cast<const std::byte*>(values);
    bytes_.insert(bytes_.end(), first, first + count * sizeof(T));
  }
  template <class T>
  void put(T value) {
    put(&value, 1);
  }
  void put_text(const std::string& text) {
    put(static_cast<std::uint32_t>(text.size()));
    put(text.data(), text.size());
  }
  Bytes finish() {
    put(checksum(bytes_));
    return std::move(bytes_);
  }

 private:
  Bytes bytes_;
};

/// Reads what a ByteWriter wrote. Throws Error ("a broken WHAT") when bytes are missing or the checksum is wrong.
class ByteReader {
 public:
  ByteReader(std::span<const std::byte> bytes, const std::string& what, const std::string& where)
      : bytes_(bytes), what_(what), where_(where) {
    std::uint32_t stored = 0;
    if (bytes_.size() < sizeof stored) fail();
    bytes_ = bytes_.first(bytes_.size() - sizeof stored);
    std::memcpy(&stored, bytes_.data() + bytes_.size(), sizeof stored);
    if (stored != checksum(bytes_)) fail();
  }
  template <class T>
  void get(T* values, std::size_t count) {
    if (count > bytes_.size() / sizeof(T)) fail();
    if (count > 0) std::memcpy(values, bytes_.data(), count * sizeof(T));
    bytes_ = bytes_.subspan(count * sizeof(T));
  }
  template <class T>
  T get() {
    T value{};
    get(&value, 1);
    return value;
  }
  std::string get_text() {
    const auto length = get<std::uint32_t>();
    if (length > bytes_.size()) fail();
    std::string text(length, '\0');
    get(text.data(), length);
    return text;
  }
  std::size_t left() const { return bytes_.size(); }
  [[noreturn]] void fail() const { throw Error("a broken " + what_, where_, "learn it again"); }

 private:
  std::span<const std::byte> bytes_;
  std::string what_, where_;
};

}  // namespace citylearn
