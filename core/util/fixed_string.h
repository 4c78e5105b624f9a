// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <ostream>
#include <string>
#include <string_view>

namespace citylearn {

/// The type of string<N> in idl/: at most N bytes, kept in place, up to the first zero. It cuts a longer text, so the
/// length of names is checked where they enter.
template <std::size_t N>
class FixedString {
 public:
  FixedString() = default;
  FixedString(const char* text) { assign(text ? std::string_view(text) : std::string_view()); }  // NOLINT
  FixedString(const std::string& text) { assign(text); }                                         // NOLINT

  const char* c_str() const { return text_; }
  std::size_t size() const { return size_; }
  std::string to_string() const { return {text_, size_}; }
  operator std::string_view() const { return {text_, size_}; }  // NOLINT

  template <std::size_t M>
  bool operator==(const FixedString<M>& other) const {
    return std::string_view(*this) == std::string_view(other);
  }
  bool operator==(const std::string& other) const { return std::string_view(*this) == other; }
  bool operator==(const char* other) const { return std::string_view(*this) == other; }
  friend std::ostream& operator<<(std::ostream& out, const FixedString& text) { return out << std::string_view(text); }

 private:
  void assign(std::string_view text) {
    size_ = std::min(N, std::min(text.size(), text.find('\0')));
    std::memcpy(text_, text.data(), size_);
  }

  char text_[N + 1] = {};
  std::size_t size_ = 0;
};

}  // namespace citylearn
