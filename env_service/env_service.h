#pragma once

#include <functional>

#include "core/node.h"
#include "env_service/traversal.h"

namespace citylearn {

struct EnvServiceOptions {
  Node::Options node;  ///< an empty id becomes "env-" + name of the traversal
  int agents = 16;     ///< M, 1..msg::MAX_AGENTS
};

/// Hosts M agents on `traversal` for the policy_service of the run, until `stop` says so (asked at least every 50 ms).
/// Observations are repeated until answered, episodes until acknowledged (docs/decisions/0003-step-protocol.md).
/// Returns once stopped; waits up to half a second for outstanding acknowledgements. Throws Error when another living
/// env_service of the run has the same id and was there first, or the middleware fails.
void run_env_service(const EnvServiceOptions& options, const Traversal& traversal, const std::function<bool()>& stop);

}  // namespace citylearn
