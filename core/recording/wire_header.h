// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "core/dds/middleware.h"

namespace citylearn {

/// The Header of a message (idl/common.idl), read from its bytes without knowing its type.
struct WireHeader {
  std::uint32_t protocol = 0;
  std::string session, sender;
  std::uint64_t incarnation = 0;
  std::uint64_t message = 0;
};

/// Returns nothing when the bytes do not begin with a Header in XCDR1.
std::optional<WireHeader> header_of(std::span<const std::byte> message);

/// Writes the same message of another session into `to`; what follows the header is copied as it is. `session` has at
/// most 64 characters. Returns false when header_of() finds nothing.
bool with_session(std::span<const std::byte> message, const std::string& session, Bytes& to);

}  // namespace citylearn
