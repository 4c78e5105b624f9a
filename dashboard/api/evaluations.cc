// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/evaluations.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "core/task/reward.h"
#include "core/task/spl.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

constexpr int kResamples = 1000;
constexpr std::uint64_t kStream = 0x626F6F74;  // names the random numbers

/// Mean over all pairs of different places; `detour` = steps away from the goal before those towards it.
template <class Detour>
ControlFigures over_all_tasks(int frames, int max_steps, Detour detour) {
  ControlFigures sum;
  const double limit = max_steps;
  for (int start = 0; start < frames; ++start)
    for (int goal = 0; goal < frames; ++goal) {
      if (start == goal) continue;
      const double shortest = std::abs(goal - start), away = detour(start, goal);
      const double steps = shortest + 2 * away;
      // Only steps that bring the agent nearer than ever before are free: a detour costs there and back.
      const bool reached = steps <= limit;
      sum.completed += reached;
      sum.spl += spl_of(reached, shortest, steps);
      sum.steps += std::min(steps, limit);
      sum.reward += EpisodeReward::total(reached, std::min(2 * away, limit), limit);
    }
  const double tasks = static_cast<double>(frames) * (frames - 1);
  return {sum.spl / tasks, sum.reward / tasks, sum.steps / tasks, sum.completed / tasks};
}

}  // namespace

EvaluationFigures evaluate(std::span<const StoreReader::TaskRow> tasks) {
  EvaluationFigures figures;
  figures.tasks = tasks.size();
  const double count = static_cast<double>(tasks.size());
  double completed = 0;
  for (const StoreReader::TaskRow& task : tasks) {
    figures.mean_steps += static_cast<double>(task.steps) / count;
    figures.shortest_mean += static_cast<double>(task.shortest) / count;
    figures.reward += task.reward / count;
    figures.spl += task.spl / count;
    if (!task.completed) continue;
    ++completed;
    figures.excess += excess_of(static_cast<double>(task.shortest), static_cast<double>(task.steps));
  }
  figures.completed = completed / count;
  figures.failed = (count - completed) / count;
  figures.excess = completed > 0 ? figures.excess / completed : std::numeric_limits<double>::quiet_NaN();

  // Percentile bootstrap: Efron & Tibshirani, An Introduction to the Bootstrap (1993), chapter 13.
  Random random{kStream, tasks.size()};
  std::vector<double> means(kResamples);
  for (double& mean : means) {
    double sum = 0;
    for (std::size_t i = 0; i < tasks.size(); ++i) sum += tasks[random.below(tasks.size())].spl;
    mean = sum / count;
  }
  std::sort(means.begin(), means.end());
  figures.spl_low = means[kResamples * 25 / 1000];
  figures.spl_high = means[kResamples * 975 / 1000 - 1];
  return figures;
}

ControlFigures blind_figures(int frames, int max_steps) {
  return over_all_tasks(frames, max_steps, [frames](int start, int goal) {
    const bool back = goal < frames / 2;
    if (back == (goal < start)) return 0;
    return back ? start : frames - 1 - start;
  });
}

ControlFigures shortest_path_figures(int frames, int max_steps) {
  return over_all_tasks(frames, max_steps, [](int, int) { return 0; });
}

}  // namespace citylearn
