// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "core/wire/node.h"

namespace citylearn {

struct ActorOptions {
  Node::Options node;
  bool stay = false;  ///< waits for the next learner when one has ended, instead of leaving
  int threads = 0;    ///< that act, as TrainerOptions::threads
};

/// Acts on env_services of the traversal that the run's learner learns from, and sends the learner what their agents
/// see and do (docs/decisions/0008-roles.md). The learner announces everything else. Returns the exit status. Throws
/// Error.
int run_actor(const ActorOptions& options);

}  // namespace citylearn
