// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace citylearn {

/// The IDL that defines a message type ("citylearn::msg::Action"), with all that it includes in front and no #include
/// left. Throws Error for a type that idl/ does not define.
std::string idl_of(const std::string& type);

}  // namespace citylearn
