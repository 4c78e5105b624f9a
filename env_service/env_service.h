// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/exchange/timing.h"
#include "core/wire/node_options.h"
#include "env_service/imperfections.h"
#include "env_service/live/live_images.h"
#include "env_service/live/robot_options.h"
#include "env_service/traversal/traversal.h"

namespace citylearn {

/// An env_service hosts the agents of one traversal. With these options its only agent is a robot.
struct LiveOptions {
  RobotOptions robot;
  std::shared_ptr<LiveImages> images;  ///< images of the traversal
};

struct EnvServiceOptions {
  NodeOptions node;                      ///< an empty id becomes "env-" + name of the traversal
  int agents = 16;                       ///< M, 1..msg::MAX_AGENTS
  Imperfections imperfections;           ///< of the agents' world; imperfect() makes a traversal that fits
  std::vector<std::string> recorders;    ///< ids of recorders for which episodes are kept even before they are heard
  double linger = kLinger.count();       ///< seconds to wait at the end for acknowledgements of live recorders
  std::optional<LiveOptions> live = {};  ///< if set, this robot is the only agent, and it was taught the traversal
  int goals = 1;                         ///< of a task, 1..kMaxGoals, reached one after the other
  int evaluation_agents = 1;             ///< at most, in an evaluation of as many tasks; never fewer than M
};

/// Hosts M agents on `traversal` for the policy_service of the session, until `stop` returns true (asked at least every
/// 50 ms). Repeats observations until they are answered (docs/decisions/0003-step-protocol.md) and episodes until all
/// recorders have acknowledged them (0009-recorders.md). Once stopped, waits up to `linger` for outstanding
/// acknowledgements of live recorders, and half a second for those of others. Throws Error when another live
/// env_service of the session has the same id and started first, or the middleware fails.
void run_env_service(const EnvServiceOptions& options, const Traversal& traversal, const std::function<bool()>& stop);

}  // namespace citylearn
