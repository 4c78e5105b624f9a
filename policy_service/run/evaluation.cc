// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation.h"

namespace citylearn {

Evaluation::Evaluation(EnvClient& client, std::vector<EnvHandle*> envs, const EvaluationOptions& options,
                       MakePolicy make_policy)
    : client_(client), options_(options), make_policy_(std::move(make_policy)) {
  for (EnvHandle* env : envs) parts_[env];
}

void Evaluation::begin(EnvHandle& env) {
  Part& part = parts_.at(&env);
  part.policy = make_policy_(env);
  part.episodes.clear();
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.first_frame() = static_cast<std::uint32_t>(options_.first_frame);
  settings.frames() = static_cast<std::uint32_t>(options_.frames);
  settings.max_steps() = static_cast<std::uint32_t>(options_.max_steps);
  settings.seed() = options_.seed;
  settings.tasks() = static_cast<std::uint32_t>(options_.tasks);
  settings.shuffle() = options_.shuffle;
  settings.policy() = options_.policy.c_str();
  settings.update() = options_.update;
  settings.run_id() = options_.run_id;
  client_.command(env, settings);
}

bool Evaluation::decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  parts_.at(&env).policy->act(observation, choice);
  steps_ += choice.size();
  return true;
}

void Evaluation::add(const EnvHandle& env, const msg::EpisodeStat& episode) {
  const auto part = parts_.find(&env);
  if (part == parts_.end() || episode.settings() != env.settings.settings()) return;
  part->second.episodes.emplace(episode.task(), episode);
}

bool Evaluation::done() const {
  for (const auto& [env, part] : parts_)
    if (static_cast<int>(part.episodes.size()) < options_.tasks) return false;
  return true;
}

double Evaluation::fraction() const {
  double finished = 0;
  for (const auto& [env, part] : parts_) finished += static_cast<double>(part.episodes.size());
  return parts_.empty() ? 1 : finished / (static_cast<double>(parts_.size()) * options_.tasks);
}

void Evaluation::check_alive() const {
  for (const auto& [env, part] : parts_)
    if (Clock::now() - env->presence.last_heard() > options_.patience)
      throw Error("went silent during the evaluation on '" + env->traversal() + "'", "env_service '" + env->id + "'",
                  "start it again, then evaluate the checkpoint with --mode evaluate");
}

std::map<std::string, Score> Evaluation::scores() const {
  std::map<std::string, Score> result;
  for (const auto& [env, part] : parts_) {
    std::vector<msg::EpisodeStat> episodes;
    for (const auto& [task, episode] : part.episodes) episodes.push_back(episode);
    result[env->traversal()] = score(episodes);
  }
  return result;
}

EvaluationHandlers::EvaluationHandlers(EnvClient& client, Evaluation& evaluation)
    : client_(client), decide_(client.decide), finished_(client.finished), joined_(client.joined) {
  client.finished = [this, &evaluation](EnvHandle& env, const msg::EpisodeStat& episode) {
    finished_(env, episode);
    evaluation.add(env, episode);
  };
  client.decide = [this, &evaluation](EnvHandle& env, const msg::Observation& observation,
                                      std::vector<std::uint8_t>& choice) {
    if (evaluation.includes(env)) return evaluation.decide(env, observation, choice);
    return decide_ && decide_(env, observation, choice);
  };
  client.joined = [this, &evaluation](EnvHandle& env) {
    if (evaluation.includes(env)) evaluation.begin(env);
    if (joined_) joined_(env);
  };
}

EvaluationHandlers::~EvaluationHandlers() {
  client_.decide = decide_;
  client_.finished = finished_;
  client_.joined = joined_;
}

}  // namespace citylearn
