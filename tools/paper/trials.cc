// SPDX-License-Identifier: Apache-2.0
#include "tools/paper/trials.h"

#include <algorithm>
#include <cmath>

namespace citylearn::paper {

Trials trials_on(const std::vector<Json>& outcomes, const std::string& traversal, bool shuffled) {
  Trials trials;
  std::vector<double> completed, spl, excess, steps, reward;
  for (const Json& rows : outcomes) {
    for (const Json& row : rows) {
      if (row["traversal"] != traversal || row.value("shuffled", false) != shuffled) continue;
      trials.tasks = row["tasks"].get<int>();
      const auto add = [&row](const char* figure, std::vector<double>& to) {
        to.push_back(row[figure].is_number() ? row[figure].get<double>() : NAN);
      };
      add("completed", completed);
      add("spl", spl);
      add("excess", excess);
      add("steps", steps);
      add("reward", reward);
      break;
    }
  }
  trials.seeds = static_cast<int>(completed.size());
  trials.completed =
      trials.seeds == 1 ? of_share(completed.front() * trials.tasks, trials.tasks) : of_mean(completed, kShares);
  trials.spl = of_mean(spl, kShares);
  trials.excess = of_mean(excess, kExcesses);
  trials.steps = of_mean(steps, kCounts);
  trials.reward = of_mean(reward, kRewards);
  return trials;
}

std::vector<std::uint64_t> first_of(const std::vector<std::uint64_t>& seeds, std::size_t most) {
  return {seeds.begin(), seeds.begin() + static_cast<std::ptrdiff_t>(std::min(most, seeds.size()))};
}

std::vector<Json> rows_of(const std::vector<Json>& outcomes) {
  std::vector<Json> all;
  for (const Json& outcome : outcomes) all.push_back(outcome["trials"]);
  return all;
}

Range range_of(const std::string& figure) {
  if (figure == "completed" || figure == "spl") return kShares;
  if (figure == "reward") return kRewards;
  return figure == "excess" ? kExcesses : kCounts;
}

std::string seeds_by_tasks(const Trials& trials) {
  return trials.seeds > 0 ? std::to_string(trials.seeds) + " x " + std::to_string(trials.tasks) : "-";
}

bool worse(const Estimate& figure, const Estimate& yardstick, double margin) {
  if (!(figure.mean < yardstick.mean - margin)) return false;  // neither when one is no number
  return !std::isfinite(figure.high) || figure.high < yardstick.mean;
}

}  // namespace citylearn::paper
