// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace citylearn {

/// Returns the SHA-256 in hexadecimal, 64 characters.
std::string sha256(std::string_view bytes);

}  // namespace citylearn
