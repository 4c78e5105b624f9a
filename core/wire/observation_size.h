// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace citylearn {

/// Bytes of an observation's features that still fit one datagram beside the rest; more are sent by reference.
inline constexpr std::size_t kMaxWholeBytes = 60'000;

}  // namespace citylearn
