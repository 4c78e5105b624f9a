// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

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

}  // namespace citylearn
