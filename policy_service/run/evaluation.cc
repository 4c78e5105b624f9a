// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation.h"

#include <algorithm>
#include <utility>

namespace citylearn {
namespace {

constexpr std::uint64_t kTasksOfAgent = 16;  // at most in one range

}  // namespace

Evaluation::Evaluation(EnvClient& client, msg::TaskSettings settings, MakePolicy make_policy,
                       const std::vector<std::string>& traversals)
    : client_(client), settings_(std::move(settings)), make_policy_(std::move(make_policy)) {
  for (const std::string& name : traversals)
    traversals_.emplace(name, Traversal{TaskWaves(settings_.tasks()), {}, {}, {}});
}

void Evaluation::add(EnvHandle& env) {
  remove(env);
  if (!traversals_.contains(env.traversal())) return;
  parts_[&env] = Part{env.traversal(), make_policy_(env), {}, env.info.agents(), {}};
  hand_out(env.traversal());
}

void Evaluation::remove(EnvHandle& env) {
  const auto found = parts_.find(&env);
  if (found == parts_.end()) return;
  const Part part = std::move(found->second);
  parts_.erase(found);
  if (part.range.count == 0) return;
  traversals_.at(part.traversal).waiting.push_back(part.range);
  hand_out(part.traversal);
}

/// Gives those env_services of a traversal that do nothing what waits to be done, and begins its next wave when all of
/// the present one is done.
void Evaluation::hand_out(const std::string& name) {
  Traversal& traversal = traversals_.at(name);
  std::vector<std::pair<EnvHandle*, Part*>> idle;
  std::uint64_t agents = 0;
  bool busy = false;
  for (auto& [env, part] : parts_) {
    if (part.traversal != name) continue;
    agents += part.agents;
    if (part.range.count > 0)
      busy = true;
    else
      idle.emplace_back(env, &part);
  }
  if (idle.empty() || traversal.waves.done()) return;
  if (!busy && traversal.waiting.empty()) {
    if (!traversal.episodes.empty()) traversal.waves.next(std::exchange(traversal.seen, {}));
    if (traversal.waves.done()) return;
    traversal.waiting.push_back(traversal.waves.wave());
  }
  std::uint64_t tasks = 0;
  for (const TaskRange& range : traversal.waiting) tasks += range.count;
  // In proportion to agents, but of a large wave a part at a time, so that those that are faster or come later help.
  for (auto& [env, part] : idle) {
    if (traversal.waiting.empty()) return;
    const std::uint64_t own = part->agents;
    give(*env, *part, traversal, std::min(own * kTasksOfAgent, (tasks * own + agents - 1) / agents));
  }
}

void Evaluation::give(EnvHandle& env, Part& part, Traversal& traversal, std::uint64_t most) {
  TaskRange& range = traversal.waiting.front();
  part.range = {range.first, static_cast<std::uint32_t>(std::min<std::uint64_t>(range.count, most))};
  range.first += part.range.count;
  range.count -= part.range.count;
  if (range.count == 0) traversal.waiting.erase(traversal.waiting.begin());
  part.policy->begin(part.range.first, traversal.waves.known());
  msg::TaskSettings settings = settings_;
  settings.first_task() = part.range.first;
  settings.tasks() = part.range.count;
  if (env.streets) settings.frames() = static_cast<std::uint32_t>(env.streets->states());
  if (settings.max_steps() == 0) settings.max_steps() = settings.frames();
  client_.command(env, settings);
}

std::vector<EnvHandle*> Evaluation::envs() const {
  std::vector<EnvHandle*> envs;
  for (const auto& [env, part] : parts_) envs.push_back(env);
  return envs;
}

std::map<std::string, int> Evaluation::open() const {
  std::map<std::string, int> open;
  for (const auto& [name, traversal] : traversals_)
    if (traversal.episodes.size() < settings_.tasks()) open[name] = 0;
  for (const auto& [env, part] : parts_)
    if (const auto found = open.find(part.traversal); found != open.end()) ++found->second;
  return open;
}

bool Evaluation::decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  Part& part = parts_.at(&env);
  part.policy->act(observation, choice);
  part.agents = std::max<std::uint64_t>(part.agents, choice.size());
  steps_ += choice.size();
  return true;
}

void Evaluation::take(EnvHandle& env, const msg::EpisodeStat& episode) {
  const auto found = parts_.find(&env);
  if (found == parts_.end() || episode.settings() != env.settings.settings()) return;
  Part& part = found->second;
  if (episode.task() < part.range.first || episode.task() - part.range.first >= part.range.count) return;
  part.episodes.emplace(episode.task(), episode);
  if (part.episodes.size() < part.range.count) return;
  Traversal& traversal = traversals_.at(part.traversal);
  traversal.episodes.merge(part.episodes);
  traversal.seen.merge(part.policy->seen());
  part.range = {};
  part.episodes.clear();
  hand_out(part.traversal);
}

double Evaluation::fraction() const {
  double finished = 0;
  for (const auto& [name, traversal] : traversals_) finished += static_cast<double>(traversal.episodes.size());
  for (const auto& [env, part] : parts_) finished += static_cast<double>(part.episodes.size());
  return traversals_.empty() ? 1 : finished / (static_cast<double>(traversals_.size()) * settings_.tasks());
}

std::map<std::string, Score> Evaluation::scores() const {
  std::map<std::string, Score> result;
  for (const auto& [name, traversal] : traversals_) {
    std::vector<msg::EpisodeStat> episodes;
    for (const auto& [task, episode] : traversal.episodes) episodes.push_back(episode);
    result[name] = score(episodes);
  }
  return result;
}

EvaluationHandlers::EvaluationHandlers(EnvClient& client, Evaluation& evaluation)
    : client_(client),
      decide_(client.decide),
      believe_(client.believe),
      finished_(client.finished),
      joined_(client.joined) {
  client.finished = [this, &evaluation](EnvHandle& env, const msg::EpisodeStat& episode) {
    finished_(env, episode);
    evaluation.take(env, episode);
  };
  client.decide = [this, &evaluation](EnvHandle& env, const msg::Observation& observation,
                                      std::vector<std::uint8_t>& choice) {
    if (evaluation.includes(env)) return evaluation.decide(env, observation, choice);
    return decide_ && decide_(env, observation, choice);
  };
  client.believe = [this, &evaluation](EnvHandle& env, msg::Belief& belief) {
    if (evaluation.includes(env)) return evaluation.believe(env, belief);
    if (believe_) believe_(env, belief);
  };
  client.joined = [this, &evaluation](EnvHandle& env) {
    if (evaluation.includes(env)) evaluation.add(env);
    if (joined_) joined_(env);
  };
}

EvaluationHandlers::~EvaluationHandlers() {
  client_.decide = decide_;
  client_.believe = believe_;
  client_.finished = finished_;
  client_.joined = joined_;
}

}  // namespace citylearn
