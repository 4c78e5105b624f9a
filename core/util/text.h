// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace citylearn {

/// Returns "a, b, c". `text` turns a part into its text: a function, or a member of the part.
template <class Parts, class Text = std::identity>
std::string joined(const Parts& parts, Text text = {}) {
  std::string all;
  for (const auto& part : parts) {
    if (!all.empty()) all += ", ";
    all += std::invoke(text, part);
  }
  return all;
}

/// Returns what stands between separators: "a", "" and "b" of "a,,b". They are parts of `text`, which must outlive
/// them.
inline std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(separator, at), text.size());
    parts.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return parts;
}

/// Returns the text behind the byte order mark that it may begin with.
inline std::string_view without_byte_order_mark(std::string_view text) {
  return text.substr(text.starts_with("\xEF\xBB\xBF") ? 3 : 0);
}

/// Replaces control characters, for one line of a message or a header: names and texts from elsewhere may hold any.
inline std::string one_line(std::string text) {
  for (char& c : text)
    if (c == '\n' || c == '\r' || c == '\t')
      c = ' ';
    else if ((c >= 0 && c < ' ') || c == '\x7F')
      c = '?';
  return text;
}

/// Returns the text with its ASCII letters in lower case.
inline std::string lower(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

}  // namespace citylearn
