// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <bit>
#include <cstdint>
#include <cstring>
#include <string_view>

namespace citylearn {

/// Reads the fields of a message in the wire format of Protocol Buffers, one after the other, without a copy.
class ProtobufReader {
 public:
  /// The message must outlive the reader.
  explicit ProtobufReader(std::string_view message) : rest_(message) {}

  /// Goes to the next field. Returns false at the end and where the message is damaged.
  bool next() {
    if (rest_.empty() || damaged_) return false;
    const std::uint64_t tag = varint();
    field_ = static_cast<int>(tag >> 3 & 0x1FFFFFFF);
    const std::uint64_t type = tag & 7;
    if (type == 0) varint();
    text_ = type == 1 ? take(8) : type == 2 ? take(varint()) : type == 5 ? take(4) : std::string_view();
    damaged_ = damaged_ || field_ == 0 || type == 3 || type == 4 || type > 5;  // groups are of old, and not read
    return !damaged_;
  }
  int field() const { return field_; }
  /// Returns the field's bytes: a text, a message; empty when it is a varint.
  std::string_view text() const { return text_; }
  /// Returns the field as a double; the message is damaged when it is not one.
  double number() {
    std::uint64_t bits = 0;
    if (text_.size() == sizeof bits)
      std::memcpy(&bits, text_.data(), sizeof bits);
    else
      damaged_ = true;
    return std::bit_cast<double>(bits);
  }
  bool damaged() const { return damaged_; }

 private:
  std::uint64_t varint() {
    std::uint64_t value = 0;
    for (int shift = 0; shift < 64 && !rest_.empty(); shift += 7) {
      const auto byte = static_cast<unsigned char>(rest_[0]);
      rest_.remove_prefix(1);
      value |= std::uint64_t{byte & 0x7Fu} << shift;
      if (byte < 0x80) return value;
    }
    damaged_ = true;
    return 0;
  }
  std::string_view take(std::uint64_t size) {
    damaged_ = damaged_ || size > rest_.size();
    if (damaged_) return {};
    const std::string_view taken = rest_.substr(0, size);
    rest_.remove_prefix(size);
    return taken;
  }
  std::string_view rest_, text_;
  int field_ = 0;
  bool damaged_ = false;
};

}  // namespace citylearn
