#pragma once

#include <string>
#include <string_view>

namespace citylearn::paper {

/// In hexadecimal, 64 characters.
std::string sha256(std::string_view bytes);

}  // namespace citylearn::paper
