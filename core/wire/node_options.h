// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "core/dds/middleware.h"

namespace citylearn {

/// What a service is on the wire.
struct NodeOptions {
  MiddlewareOptions middleware;
  std::string service;  ///< kind: "env_service"
  std::string id;       ///< unique within the session, at most 64 characters
  std::string session =
      "default";  ///< messages of other sessions are ignored, at most 64 characters; empty: hears all sessions
};

/// Counts of a node's traffic, as published in ServiceStatus.
struct Traffic {
  std::uint64_t received = 0;
  std::uint64_t repeated = 0;
  std::uint64_t resent = 0;
  std::uint64_t rejected = 0;
  std::uint64_t foreign = 0;
};

}  // namespace citylearn
