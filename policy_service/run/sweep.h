// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "policy_service/run/policy_service.h"

namespace citylearn {

/// Parses "1..5", "1,3,7" or "1..3,9". Throws Error naming what is wrong: a descending range, a repeated seed, not a
/// number, more than 1000 seeds.
std::vector<std::uint64_t> parse_seeds(const std::string& text);

/// Trains one agent once for each seed, one after the other, each in a folder of its own: output/seed-1 ... Node and
/// env_services stay. Then writes output/sweep.json and prints its tables. With `resume`, complete seeds are skipped
/// and the interrupted one continues. Returns the exit status. Throws Error before anything runs when the options do
/// not fit or a finished seed belongs to another run, and at the end, naming them, when seeds failed; the others have
/// then run.
int run_sweep(const PolicyServiceOptions& options, const std::vector<std::uint64_t>& seeds);

}  // namespace citylearn
