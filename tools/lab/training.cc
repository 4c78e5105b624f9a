// SPDX-License-Identifier: Apache-2.0
#include "tools/lab/training.h"

#include <algorithm>

#include "policy_service/rollout/task_waves.h"

namespace citylearn {

NetworkTask network_task(const Traversal& route, int first, int frames) {
  if (first < 0 || frames < 2 || first + frames > route.frames)
    throw Error("has " + std::to_string(route.frames) + " frames, the route needs frames " + std::to_string(first) +
                    ".." + std::to_string(first + frames - 1),
                "traversal '" + route.name + "'", "choose fewer");
  NetworkTask task;
  task.frames = frames;
  task.features = route.dimension;
  task.streets = route.states();
  task.reference =
      Eigen::Map<const Matrix<float>>(route.features.data(), route.dimension, route.frames).middleCols(first, frames);
  return task;
}

InprocessTraining::InprocessTraining(const TrainerOptions& options, const Traversal& route, int frames,
                                     const Hosting& hosting)
    : trainer_(options, network_task(route, options.first_frame, frames)) {
  const int agents = std::max(1, static_cast<int>(trainer_.parameters()["trainer"]["agents"]) / hosting.environments);
  for (int i = 0; i < hosting.environments; ++i) {
    environments_.emplace_back(route, agents, hosting.imperfections);
    trainer_.add(i, agents);
  }
}

void InprocessTraining::step(Environment& environment) {
  environment.step(choice_);
  finished_.insert(finished_.end(), environment.finished().begin(), environment.finished().end());
}

UpdateFigures InprocessTraining::update() {
  const bool anew = trainer_.generation() != generation_;
  generation_ = trainer_.generation();
  finished_.clear();
  for (std::size_t i = 0; i < environments_.size(); ++i) {
    Environment& environment = environments_[i];
    const int number = static_cast<int>(i);
    if (anew) {
      trainer_.settings(number, settings_);
      environment.reset(settings_);
    } else {
      const Clock::time_point begin = Clock::now();
      trainer_.resume(number, choice_);
      acting_ += seconds_since(begin);
      step(environment);
    }
    while (true) {
      environment.observe(observation_);
      const Clock::time_point begin = Clock::now();
      const bool more = trainer_.act(number, observation_, choice_);
      acting_ += seconds_since(begin);
      if (!more) break;
      step(environment);
    }
  }
  const Clock::time_point begin = Clock::now();
  const UpdateFigures figures = trainer_.update();
  learning_ += seconds_since(begin);
  return figures;
}

std::vector<Environment::Episode> try_out(Policy& policy, const Traversal& traversal, const Trial& trial) {
  const int room = traversal.dimension > 0 ? static_cast<int>(msg::MAX_FEATURES) / traversal.dimension : 256;
  Environment environment(traversal, std::max(1, std::min({256, room, trial.tasks})), trial.imperfections, trial.goals);
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.first_frame() = static_cast<std::uint32_t>(trial.first_frame);
  settings.frames() = static_cast<std::uint32_t>(trial.frames);
  settings.max_steps() = static_cast<std::uint32_t>(trial.max_steps);
  settings.max_detour() = static_cast<std::uint32_t>(trial.max_detour);
  settings.seed() = trial.seed;
  settings.shuffle() = trial.shuffle;
  std::vector<Environment::Episode> episodes(static_cast<std::size_t>(trial.tasks));
  msg::Observation observation;
  std::vector<std::uint8_t> choice;
  for (TaskWaves waves(static_cast<std::uint32_t>(trial.tasks)); !waves.done(); waves.next(policy.seen())) {
    settings.first_task() = waves.wave().first;
    settings.tasks() = waves.wave().count;
    environment.reset(settings);
    policy.begin(waves.wave().first, waves.known());
    while (!environment.done()) {
      trial.interrupt();
      environment.observe(observation);
      policy.act(observation, choice);
      environment.step(choice);
      for (const Environment::Episode& episode : environment.finished())
        episodes[static_cast<std::size_t>(episode.task)] = episode;
    }
  }
  return episodes;
}

Score score(const std::vector<Environment::Episode>& episodes) {
  std::vector<msg::EpisodeStat> stats(episodes.size());
  for (std::size_t i = 0; i < episodes.size(); ++i) {
    stats[i].steps() = static_cast<std::uint32_t>(episodes[i].steps);
    stats[i].shortest() = static_cast<std::uint32_t>(episodes[i].shortest);
    stats[i].reward() = episodes[i].reward;
    stats[i].completed() = episodes[i].completed;
  }
  return score(stats);
}

}  // namespace citylearn
