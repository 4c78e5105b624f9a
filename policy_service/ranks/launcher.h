// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "policy_service/records/policy_service_options.h"

namespace citylearn {

/// Completes the rank and the number of ranks from the environment of the launcher where they are not given: Open
/// MPI's, then that of PMI (MPICH), then Slurm's, since under mpirun in a Slurm job every process has its SLURM_PROCID
/// 0. A rank of -1 and 0 ranks are not given. Throws Error naming what is missing or out of range.
void number_ranks(PolicyServiceOptions& options);

}  // namespace citylearn
