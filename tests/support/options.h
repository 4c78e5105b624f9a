// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "core/wire/node_options.h"

namespace citylearn::testing {

/// Returns the options of a middleware on this machine's loopback.
inline MiddlewareOptions middleware_options(const std::string& name, std::uint32_t domain = 0,
                                            const std::string& participant = "") {
  MiddlewareOptions options;
  options.name = name;
  options.domain = domain;
  options.participant = participant;
  return options;
}

}  // namespace citylearn::testing
