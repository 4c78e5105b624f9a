// SPDX-License-Identifier: Apache-2.0
#include "core/command_line/wrap.h"

#include <sstream>

namespace citylearn {

std::string wrapped(const std::string& text, std::size_t indent) {
  std::istringstream words(text);
  std::string result, word;
  std::size_t column = indent;
  while (words >> word) {
    if (!result.empty()) {
      const bool fits = column + 1 + word.size() <= kTerminalWidth;
      result += fits ? " " : "\n" + std::string(indent, ' ');
      column = fits ? column + 1 : indent;
    }
    result += word;
    column += word.size();
  }
  return result;
}

}  // namespace citylearn
