#include "tools/paper/trials.h"

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
  trials.completed = trials.seeds == 1 ? of_share(completed.front() * trials.tasks, trials.tasks) : of_mean(completed);
  trials.spl = of_mean(spl);
  trials.excess = of_mean(excess);
  trials.steps = of_mean(steps);
  trials.reward = of_mean(reward);
  return trials;
}

std::string seeds_by_tasks(const Trials& trials) {
  return trials.seeds > 0 ? std::to_string(trials.seeds) + " x " + std::to_string(trials.tasks) : "-";
}

bool worse(const Estimate& figure, const Estimate& yardstick, double margin) {
  if (!(figure.mean < yardstick.mean - margin)) return false;  // neither when one is no number
  return !std::isfinite(figure.high) || figure.high < yardstick.mean;
}

}  // namespace citylearn::paper
