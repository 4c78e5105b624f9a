// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "core/dds/middleware.h"

namespace citylearn {

/// Describes a service to the other services of its domain.
struct NodeOptions {
  MiddlewareOptions middleware;
  std::string service;              ///< kind: "env_service"
  std::string id;                   ///< a name (core/util/name.h), unique within the session
  std::string session = "default";  ///< a name: messages of other sessions are ignored; empty: hears all sessions
  std::string metrics{};            ///< where to serve /metrics and /healthz, "[ADDRESS:]PORT"; empty: nowhere
};

/// Counts of a node's traffic, as published in ServiceStatus.
struct Traffic {
  std::uint64_t received = 0;
  std::uint64_t repeated = 0;
  std::uint64_t resent = 0;
  std::uint64_t rejected = 0;
  std::uint64_t foreign = 0;
  std::uint64_t sent_bytes = 0;
  std::uint64_t received_bytes = 0;
};

}  // namespace citylearn
