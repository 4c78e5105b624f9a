// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/env_client/env_client.h"
#include "policy_service/records/policy_service_options.h"

namespace citylearn {

/// Trains and evaluates agents on the env_services of its run. Returns the exit status. Throws Error.
int run_policy_service(const PolicyServiceOptions& options);
/// Performs one of several runs on the same node; the env_services wait in between. `options` must have passed
/// checked_options().
int run_policy_service(const PolicyServiceOptions& options, Node& node, EnvClient& client);
/// Fills in options that follow from others (step limit, controls, configuration). Throws Error naming a wrong one.
PolicyServiceOptions checked_options(PolicyServiceOptions options);

}  // namespace citylearn
