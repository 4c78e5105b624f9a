// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <bit>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string_view>
#include <type_traits>
#include <vector>

#include "core/util/types.h"

namespace citylearn {

inline constexpr std::size_t kEncapsulation = 4;  ///< bytes in front of CDR that name its kind

/// Returns the bytes of padding before a number of `size` bytes, `at` bytes behind the encapsulation.
constexpr std::size_t cdr_padding(std::size_t at, std::size_t size) { return (size - at % size) % size; }

/// Writes plain CDR (OMG's DDS-XTypes 1.3, 7.4.1: encoding version 1), little endian, whose padding is zero. It visits
/// a message's fields (idl/message_fields.h, ros2/ros2_fields.h) and checks nothing.
class CdrWriter {
 public:
  /// Keeps the capacity of `bytes`, and nothing that they hold.
  explicit CdrWriter(Bytes& bytes) : bytes_(bytes) {
    bytes_.assign({std::byte{0}, std::byte{1}, std::byte{0}, std::byte{0}});
  }

  template <class Number>
  requires std::is_arithmetic_v<Number>
  void operator()(const char*, Number number) { write(&number, 1); }
  template <class Text>
  requires std::is_convertible_v<const Text&, std::string_view>
  void operator()(const char*, const Text& field) {
    const std::string_view text = field;
    write_length(text.size() + 1);
    write(text.data(), text.size());
    bytes_.push_back(std::byte{0});
  }
  template <class Number>
  void operator()(const char*, const std::vector<Number>& sequence, std::size_t /*bound*/ = 0) {
    write_length(sequence.size());
    write(sequence.data(), sequence.size());
  }
  template <class Number, std::size_t N>
  void operator()(const char*, const std::array<Number, N>& numbers) {
    write(numbers.data(), N);
  }
  template <class Enum>
  void enumerator(const char*, Enum value, Enum /*last*/) {
    write_length(value);
  }
  void protocol(const char*, std::uint32_t number) { write_length(number); }
  template <class Message>
  void nested(const char*, const Message& message) {
    visit(message, *this);
  }

 private:
  void write_length(std::size_t length) { (*this)("", static_cast<std::uint32_t>(length)); }
  template <class Number>
  void write(const Number* numbers, std::size_t count) {
    static_assert(std::endian::native == std::endian::little);
    if (count == 0) return;
    bytes_.resize(bytes_.size() + cdr_padding(bytes_.size() - kEncapsulation, sizeof(Number)));
    const std::byte* begin = reinterpret_cast<const std::byte*>(numbers);
    bytes_.insert(bytes_.end(), begin, begin + count * sizeof(Number));
  }

  Bytes& bytes_;
};

/// A fault of bytes that are read, in words.
struct CdrError {
  const char* what;
};

/// Reads plain CDR of either byte order.
class CdrReader {
 public:
  /// `bytes` begin with an encapsulation of plain CDR. Throws CdrError when they have none.
  explicit CdrReader(std::span<const std::byte> bytes) : bytes_(bytes) {
    if (bytes.size() < kEncapsulation || bytes[0] != std::byte{0} || bytes[1] > std::byte{1})
      throw CdrError{"not plain CDR"};
    swaps_ = bytes[1] == std::byte{0};
  }
  /// Reads so many numbers. Throws CdrError when the bytes are too few, or not numbers of this type.
  template <class Number>
  void read(Number* numbers, std::size_t count) {
    if (count == 0) return;
    const std::size_t padding = cdr_padding(at_ - kEncapsulation, sizeof(Number)), size = count * sizeof(Number);
    if (padding > left() || count > (left() - padding) / sizeof(Number)) throw CdrError{"cut short"};
    const std::byte* const begin = bytes_.data() + at_ + padding;
    if constexpr (std::is_same_v<Number, bool>)
      if (std::any_of(begin, begin + size, [](auto one) { return one > std::byte{1}; }))
        throw CdrError{"not a boolean"};
    std::memcpy(numbers, begin, size);
    at_ += padding + size;
    if (!swaps_) return;
    for (std::byte* one = reinterpret_cast<std::byte*>(numbers); count > 0; --count, one += sizeof(Number))
      std::reverse(one, one + sizeof(Number));
  }
  std::uint32_t read_length() {
    std::uint32_t length = 0;
    read(&length, 1);
    return length;
  }
  std::size_t left() const { return bytes_.size() - at_; }

 private:
  std::span<const std::byte> bytes_;
  std::size_t at_ = kEncapsulation;
  bool swaps_ = false;
};

}  // namespace citylearn
