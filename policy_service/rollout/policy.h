// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <vector>

#include "core/wire/messages.h"
#include "policy_service/network/feature_normaliser.h"

namespace citylearn {

/// Chooses the actions of all agents of one env_service, tick after tick: a learned agent or a control. What it does in
/// a task depends on that task and on `known` alone, so several env_services may divide an evaluation, by any number of
/// agents.
class Policy {
 public:
  virtual ~Policy() = default;
  /// Begins tasks of an evaluation, as the settings of the next observation have them: agent a of M performs first_task
  /// + a, then M further. `known`: what was seen of the traversal in earlier tasks.
  virtual void begin(std::uint32_t /*first_task*/, const SeenFeatures& /*known*/) {}
  /// Chooses one allowed action per agent. Called once for each step, in order. An agent whose FLAG_FIRST is set begins
  /// a new episode, and its memory of the last one is wiped.
  virtual void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) = 0;
  /// Fills what the agents believed after the last act(). A policy without a belief leaves it empty.
  virtual void believe(msg::Belief& /*belief*/) const {}
  /// Returns what was seen in each task since begin(); of a policy that learns nothing from it, nothing.
  virtual std::map<std::uint32_t, SeenFeatures> seen() const { return {}; }
};

}  // namespace citylearn
