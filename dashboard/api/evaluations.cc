// SPDX-License-Identifier: Apache-2.0
#include "dashboard/api/evaluations.h"

#include <algorithm>
#include <limits>

#include "core/task/spl.h"
#include "core/util/random.h"

namespace citylearn {
namespace {

constexpr int kResamples = 1000;
constexpr std::uint64_t kStream = 0x626F6F74;  // names the random numbers

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

}  // namespace citylearn
