// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "core/files/safetensors.h"
#include "policy_service/network/checkpoint/trained_agent.h"

namespace citylearn {

/// Returns the agent's parameters under the names of the network's tensors, each rows x cols; and, where the network
/// was built around a route, its features as `reference`, N x D. `metadata` goes along with what the agent is.
Safetensors parameters_of(const TrainedAgent& agent, const std::map<std::string, std::string>& metadata);

/// Puts the file's parameters in the place of the agent's. A vector of n may be of shape [n] or [n, 1]; `reference` is
/// not looked at. Throws Error naming the file and the tensor that is missing, unknown, of another shape or not finite,
/// or the other network it was made for; the agent is then as before.
void load_parameters(const std::string& path, TrainedAgent& agent);

}  // namespace citylearn
