// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "core/wire/messages.h"

namespace citylearn {

/// Decides for all agents of one env_service, tick after tick. The learned agents and the controls alike.
class Policy {
 public:
  virtual ~Policy() = default;
  /// Actions for one observation; called once for each step, in order. `choice` gets one allowed action per agent.
  /// An agent whose FLAG_FIRST is set begins a new episode: memory of the last one is wiped.
  virtual void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) = 0;
};

}  // namespace citylearn
