// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

namespace citylearn::simulation {

/// Calls `body` as a process of a simulation and returns its exit status. The programs that it starts by
/// testing::Service run there too: env_service, encoder_service and policy_service with their own main functions and
/// command lines, and recorder_process. Their time is virtual, and so is that of `body`. What happens in which order is
/// drawn from CITYLEARN_SIMULATION_SEED (1).
int run_simulated(const std::function<int()>& body);

}  // namespace citylearn::simulation
