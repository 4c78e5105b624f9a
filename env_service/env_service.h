// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "core/wire/node.h"
#include "env_service/dataset_io/traversal.h"

namespace citylearn {

struct EnvServiceOptions {
  Node::Options node;                  ///< an empty id becomes "env-" + name of the traversal
  int agents = 16;                     ///< M, 1..msg::MAX_AGENTS
  std::vector<std::string> recorders;  ///< those that episodes are kept for before they are heard of
  double linger = 5;                   ///< seconds, at the end, for recorders that live to acknowledge
};

/// Hosts M agents on `traversal` for the policy_service of the run, until `stop` says so (asked at least every 50 ms).
/// Observations are repeated until answered (docs/decisions/0003-step-protocol.md), episodes until all who record them
/// have acknowledged them (0009-recorders.md). Returns once stopped; waits up to `linger` for outstanding
/// acknowledgements of recorders that live, half a second for those of others. Throws Error when another living
/// env_service of the run has the same id and was there first, or the middleware fails.
void run_env_service(const EnvServiceOptions& options, const Traversal& traversal, const std::function<bool()>& stop);

}  // namespace citylearn
