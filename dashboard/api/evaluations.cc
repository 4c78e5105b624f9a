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

/// The mean over all pairs of different places of a route. Tasks are added by ranges, as a long route has millions.
class ControlMean {
 public:
  ControlMean(int frames, int max_steps)
      : tasks_(static_cast<double>(frames) * (frames - 1)), limit_(max_steps), inverses_(3 * std::size_t(frames) + 1) {
    for (std::size_t i = 1; i < inverses_.size(); ++i) inverses_[i] = inverses_[i - 1] + 1 / static_cast<double>(i);
  }

  /// Adds tasks whose shortest paths have first, first + 1 .. last steps, and whose agent first goes `away` steps from
  /// the goal: it takes shortest + 2 away steps. `first` >= 1; there are none when `last` < `first`.
  void add(int first, int last, int away) {
    if (last < first) return;
    const double there_and_back = 2.0 * away;
    const int longest = static_cast<int>(std::min<double>(last, limit_ - there_and_back));  // that is completed
    const double completed = std::max(0, longest - first + 1), failed = last - first + 1 - completed;
    sum_.completed += completed;
    // shortest / (shortest + 2 away) is 1 - 2 away / steps.
    if (completed > 0)
      sum_.spl += completed - there_and_back * (inverses_[longest + 2 * away] - inverses_[first - 1 + 2 * away]);
    sum_.steps += completed * ((first + std::max(first, longest)) / 2.0 + there_and_back) + failed * limit_;
    // Only steps that bring the agent nearer than ever before are free: a detour costs there and back.
    const double costly = std::min(there_and_back, limit_);
    sum_.reward +=
        completed * EpisodeReward::total(true, costly, limit_) + failed * EpisodeReward::total(false, costly, limit_);
  }
  ControlFigures mean() const {
    return {sum_.spl / tasks_, sum_.reward / tasks_, sum_.steps / tasks_, sum_.completed / tasks_};
  }

 private:
  const double tasks_, limit_;
  std::vector<double> inverses_;  // 1/1 + .. + 1/i
  ControlFigures sum_;
};

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
  ControlMean mean(frames, max_steps);
  const int half = frames / 2, end = frames - 1;
  for (int start = 0; start < frames; ++start) {
    // Goals in the first half: it goes back.
    mean.add(start - std::min(start, half) + 1, start, 0);
    mean.add(1, half - 1 - start, start);
    // Goals in the second half: it goes on.
    mean.add(std::max(start + 1, half) - start, end - start, 0);
    mean.add(1, start - half, end - start);
  }
  return mean.mean();
}

ControlFigures shortest_path_figures(int frames, int max_steps) {
  ControlMean mean(frames, max_steps);
  for (int start = 0; start < frames; ++start) {
    mean.add(1, start, 0);
    mean.add(1, frames - 1 - start, 0);
  }
  return mean.mean();
}

}  // namespace citylearn
