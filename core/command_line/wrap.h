// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

namespace citylearn {

inline constexpr std::size_t kTerminalWidth = 80;  ///< columns

/// Returns `text` in lines of kTerminalWidth columns, broken between words, without a line break at the end. The lines
/// after the first are indented by `indent`. The first one is not: the caller has printed so many columns before it.
std::string wrapped(const std::string& text, std::size_t indent = 0);

}  // namespace citylearn
