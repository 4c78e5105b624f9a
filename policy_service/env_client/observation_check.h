// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "policy_service/env_client/env_client_options.h"
#include "policy_service/env_client/env_handle.h"

namespace citylearn {

/// Returns whether the env_service that announced this sends frames by name. Throws Error when it must not and cannot
/// send features.
bool by_reference(Observing observing, const msg::TraversalInfo& info);

/// Checks an observation against the settings that are in force, and fills in the features that the env_service left
/// out. Returns what is wrong with it ("of another number of agents"); empty when nothing is.
std::string check_and_complete(const EnvHandle& env, msg::Observation& observation);

}  // namespace citylearn
