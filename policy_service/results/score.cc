// SPDX-License-Identifier: Apache-2.0
#include "policy_service/results/score.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "core/task/spl.h"

namespace citylearn {

Score score(const std::vector<msg::EpisodeStat>& episodes) {
  Score result;
  result.tasks = static_cast<int>(episodes.size());
  if (episodes.empty()) return result;
  int completed = 0;
  for (const msg::EpisodeStat& episode : episodes) {
    result.mean_steps += episode.steps();
    result.shortest_mean += episode.shortest();
    result.reward += episode.reward();
    if (!episode.completed()) continue;
    ++completed;
    result.excess += excess_of(episode.shortest(), episode.steps());
    result.spl += spl_of(true, episode.shortest(), episode.steps());
  }
  const double tasks = result.tasks;
  result.completed = completed / tasks;
  result.spl /= tasks;
  result.mean_steps /= tasks;
  result.shortest_mean /= tasks;
  result.reward /= tasks;
  if (completed > 0) result.excess /= completed;
  return result;
}

std::string table(const std::vector<ScoreRow>& rows) {
  std::size_t policy = 6, traversal = 9;
  for (const ScoreRow& row : rows) {
    policy = std::max(policy, row.policy.size());
    traversal = std::max(traversal, row.traversal.size());
  }
  std::string text =
      fmt::format("{:<{}}  {:<{}}  {:>9}  {:>5}  {:>6}  {:>6}  {:>8}  {:>6}  {:>5}\n", "policy", policy, "traversal",
                  traversal, "completed", "SPL", "excess", "steps", "shortest", "reward", "tasks");
  for (const ScoreRow& row : rows) {
    const Score& s = row.score;
    text += fmt::format("{:<{}}  {:<{}}  {:>7.1f} %  {:>5.3f}  {:>6.2f}  {:>6.1f}  {:>8.1f}  {:>6.3f}  {:>5}\n",
                        row.policy, policy, row.traversal, traversal, 100 * s.completed, s.spl, s.excess, s.mean_steps,
                        s.shortest_mean, s.reward, s.tasks);
  }
  return text;
}

}  // namespace citylearn
