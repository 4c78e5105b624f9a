// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "core/wire/messages.h"

namespace citylearn {

/// Figures of one policy on one traversal: means over tasks, fractions as 0..1.
struct Score {
  int tasks = 0;
  double completed = 0;  ///< share of tasks whose goal was reached within the step limit
  double spl =
      0;  ///< success weighted by path length, Anderson et al. 2018: mean of success x shortest / max(shortest, taken)
  double excess = 0;         ///< taken / shortest, mean over completed tasks; 0 when none was completed
  double mean_steps = 0;     ///< failed tasks count with all steps they took
  double shortest_mean = 0;  ///< frames
  double reward = 0;
};

Score score(const std::vector<msg::EpisodeStat>& episodes);

/// One line of the final table.
struct ScoreRow {
  std::string policy;  ///< "place_filter", "blind" ...
  std::string traversal;
  Score score;
};

/// Returns a table for people, one row for each policy and traversal.
std::string table(const std::vector<ScoreRow>& rows);

}  // namespace citylearn
