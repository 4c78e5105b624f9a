// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace citylearn {

inline constexpr std::size_t kTerminalWidth = 80;  ///< columns

/// Returns `text` in lines of kTerminalWidth columns, broken between words. The first line begins at column `indent`,
/// which whoever prints it has reached; the others are indented by as much. No line break at the end.
std::string wrapped(const std::string& text, std::size_t indent = 0);

}  // namespace citylearn
