// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation.h"

namespace citylearn {
namespace {

constexpr std::chrono::seconds kPatience{30};  // with an env_service that is silent

}  // namespace

Evaluation::Evaluation(EnvClient& client, std::vector<EnvHandle*> envs, msg::TaskSettings settings,
                       MakePolicy make_policy)
    : client_(client), settings_(std::move(settings)), make_policy_(std::move(make_policy)) {
  for (EnvHandle* env : envs) parts_[env];
}

void Evaluation::begin(EnvHandle& env) {
  Part& part = parts_.at(&env);
  part.policy = make_policy_(env);
  part.episodes.clear();
  client_.command(env, settings_);
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
    if (part.episodes.size() < settings_.tasks()) return false;
  return true;
}

double Evaluation::fraction() const {
  double finished = 0;
  for (const auto& [env, part] : parts_) finished += static_cast<double>(part.episodes.size());
  return parts_.empty() ? 1 : finished / (static_cast<double>(parts_.size()) * settings_.tasks());
}

void Evaluation::check_alive() const {
  for (const auto& [env, part] : parts_)
    if (Clock::now() - env->presence.last_heard() > kPatience)
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
