// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "core/wire/messages.h"
#include "env_service/environment.h"
#include "tests/support/env/env.h"

namespace citylearn::testing {

/// A navigator that learns nothing: chooses for one agent of an observation. Keeps what it must by agent.
class Walker {
 public:
  virtual ~Walker() = default;
  virtual std::uint8_t act(const msg::Observation& seen, std::size_t agent) = 0;
};

/// Never looks. A goal in the lower half of a route of `frames` from frame 0: sets out backwards, else forwards.
class BlindSweep : public Walker {
 public:
  explicit BlindSweep(int frames) : frames_(frames), heading_(msg::MAX_AGENTS, kNext) {}
  std::uint8_t act(const msg::Observation& seen, std::size_t agent) override {
    std::uint8_t& heading = heading_[agent];
    if (seen.flags()[agent] & msg::FLAG_FIRST)
      heading = static_cast<int>(seen.goal()[agent]) < frames_ / 2 ? kPrevious : kNext;
    // The mask shows the end of the route: it turns round there.
    if (!(seen.allowed()[agent] >> heading & 1)) heading = heading == kNext ? kPrevious : kNext;
    return heading;
  }

 private:
  int frames_;
  std::vector<std::uint8_t> heading_;
};

/// Knows where it stands.
class ShortestPath : public Walker {
 public:
  std::uint8_t act(const msg::Observation& seen, std::size_t agent) override {
    return seen.position()[agent] < seen.goal()[agent] ? kNext : kPrevious;
  }
};

/// Figures of `tasks` evaluation tasks.
struct Figures {
  double completed = 0;  ///< share, 0..1
  double steps = 0;      ///< mean
  double reward = 0;     ///< mean
  double spl = 0;        ///< mean of success x shortest / max(shortest, taken)
  double excess = 0;     ///< mean of taken / shortest over the completed
  double shortest = 0;   ///< mean
};

/// Settings of the evaluation that TASK's figures are about: the first 128 frames, 128 steps.
inline msg::TaskSettings evaluation(std::uint32_t tasks, std::uint32_t frames = 128, std::uint32_t max_steps = 128) {
  msg::TaskSettings all = settings(msg::EVALUATE, frames, max_steps, 7);
  all.tasks() = tasks;
  return all;
}

/// Every episode of a whole evaluation, by its task.
inline std::map<int, Environment::Episode> evaluate(Environment& environment, const msg::TaskSettings& settings,
                                                    Walker& walker) {
  std::map<int, Environment::Episode> episodes;
  msg::Observation seen;
  environment.reset(settings);
  std::vector<std::uint8_t> choice(environment.agents());
  while (!environment.done()) {
    environment.observe(seen);
    for (std::size_t agent = 0; agent < choice.size(); ++agent)
      choice[agent] = seen.flags()[agent] & msg::FLAG_IDLE ? std::uint8_t{255} : walker.act(seen, agent);
    environment.step(choice);
    for (const Environment::Episode& episode : environment.finished())
      EXPECT_TRUE(episodes.emplace(episode.task, episode).second) << "task " << episode.task << " came twice";
  }
  return episodes;
}

inline Figures walk(Environment& environment, const msg::TaskSettings& settings, Walker& walker) {
  Figures figures;
  for (const auto& [task, episode] : evaluate(environment, settings, walker)) {
    figures.steps += episode.steps;
    figures.reward += episode.reward;
    figures.shortest += episode.shortest;
    if (!episode.completed) continue;
    figures.completed += 1;
    figures.spl += static_cast<double>(episode.shortest) / episode.steps;
    figures.excess += static_cast<double>(episode.steps) / episode.shortest;
  }
  const double tasks = settings.tasks();
  figures.excess /= std::max(figures.completed, 1.0);
  for (double* sum : {&figures.completed, &figures.steps, &figures.reward, &figures.spl, &figures.shortest})
    *sum /= tasks;
  return figures;
}

}  // namespace citylearn::testing
