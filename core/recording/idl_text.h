// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// Returns the IDL of a message type ("citylearn::msg::Action"), where the files that it includes replace its #include
/// lines. Throws Error for a type that idl/ does not define.
std::string idl_of(const std::string& type);

}  // namespace citylearn
