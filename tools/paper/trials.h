// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "tools/paper/statistics.h"
#include "tools/paper/work.h"

namespace citylearn::paper {

/// What the trials of several seeds on one traversal say together.
struct Trials {
  int seeds = 0, tasks = 0;  ///< tasks of each seed
  Estimate completed;        ///< share; mean over the seeds, of one seed (or a control) Wilson's, over its tasks
  Estimate spl, excess, steps, reward;  ///< means over the seeds
};

/// `outcomes`: one a seed, each a list of rows {"traversal", "shuffled" where it may be so, SCORE} as units of work
/// have them (study.h). Outcomes that are null, of units that failed, and those without such a row are left out.
Trials trials_on(const std::vector<Json>& outcomes, const std::string& traversal, bool shuffled = false);

/// The first `most` of them.
std::vector<std::uint64_t> first_of(const std::vector<std::uint64_t>& seeds, std::size_t most);

/// Outcomes of the seeds whose unit of work, `unit_of_seed(seed)`, did not fail.
template <class UnitOfSeed>
std::vector<Json> outcomes_of(const Work& work, const std::vector<std::uint64_t>& seeds,
                              const UnitOfSeed& unit_of_seed) {
  std::vector<Json> all;
  for (const std::uint64_t seed : seeds)
    if (const Json& outcome = work.outcome(unit_of_seed(seed).spec); !outcome.is_null()) all.push_back(outcome);
  return all;
}

/// Of outcomes of trainings (study.h) their trials, as trials_on() takes them.
std::vector<Json> rows_of(const std::vector<Json>& outcomes);

/// Where a SCORE's figure lies, by its name.
Range range_of(const std::string& figure);

/// "3 x 2000", "-" for none.
std::string seeds_by_tasks(const Trials& trials);

/// A policy's figure is worse than a yardstick's on the same tasks: by more than `margin`, and not by chance alone
/// where there is an interval to tell.
bool worse(const Estimate& figure, const Estimate& yardstick, double margin);

}  // namespace citylearn::paper
