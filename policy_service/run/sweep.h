// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "policy_service/run/policy_service.h"

namespace citylearn {

/// Seeds of "1..5", "1,3,7" or "1..3,9", in that order. Throws Error naming what is wrong: a range that goes down, a
/// seed named twice, no number, more than 1000 of them.
std::vector<std::uint64_t> parse_seeds(const std::string& text);

/// A figure over several runs. Runs that do not have it (an SPL of 0.95 that was never reached) are not counted.
struct Spread {
  int count = 0;  ///< runs that have it; 0: the others mean nothing
  double mean = 0, median = 0, minimum = 0, maximum = 0;
  double deviation = 0;  ///< standard, of the sample; 0 for one run
};
Spread spread_of(std::vector<double> values);

/// Trains one agent once for each seed, one after the other, each in a folder of its own: output/seed-1 ... Node and
/// env_services stay. Then writes output/sweep.json and prints the tables of it. With `resume`, seeds that are complete
/// are skipped and the interrupted one goes on. Returns the exit status. Throws Error: before anything runs, when the
/// options do not fit or a finished seed is of another run; at the end, naming them, when seeds failed. The others have
/// then run.
int run_sweep(const PolicyServiceOptions& options, const std::vector<std::uint64_t>& seeds);

/// Markdown tables of several runs or sweeps, side by side: median (lowest..highest) of each figure. `runs` are folders
/// with a sweep.json or a summary.json, or these files. Throws Error naming the one that is neither.
std::string tables_of(const std::vector<std::string>& runs);

}  // namespace citylearn
