// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "core/plugin/registry.h"
#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Returns place_filter's network for a task on streets.
template <class S>
std::unique_ptr<AgentNetwork<S>> make_street_filter(const Parameters& parameters, const NetworkTask& task);

}  // namespace citylearn
