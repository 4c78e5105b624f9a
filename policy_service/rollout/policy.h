// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/wire/messages.h"

namespace citylearn {

/// Chooses the actions of all agents of one env_service, tick after tick: a learned agent or a control.
class Policy {
 public:
  virtual ~Policy() = default;
  /// Chooses one allowed action per agent. Called once for each step, in order. An agent whose FLAG_FIRST is set begins
  /// a new episode, and its memory of the last one is wiped.
  virtual void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) = 0;
};

}  // namespace citylearn
