// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/wire/node.h"

namespace citylearn {

struct ActorOptions {
  Node::Options node;
  bool stay = false;  ///< wait for the next learner when one has done, instead of leaving
};

/// Serves env_services of the traversal that the run's learner learns from and sends it what their agents see and do
/// (docs/decisions/0008-roles.md). All else it hears from the learner. Returns the exit status. Throws Error.
int run_actor(const ActorOptions& options);

}  // namespace citylearn
