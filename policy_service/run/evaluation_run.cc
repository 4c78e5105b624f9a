// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation_run.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "policy_service/interchange/safetensors.h"
#include "policy_service/network/checkpoint.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"

namespace citylearn {
namespace {

// Purposes of random streams: (seed, purpose, ...) names a stream.
enum : std::uint64_t { kEvaluationTasks = 102, kEvaluationChoices = 103 };

constexpr std::chrono::seconds kPatience{30};  // with an env_service that is silent

}  // namespace

Evaluation::Evaluation(EnvClient& client, msg::TaskSettings settings, MakePolicy make_policy)
    : client_(client), settings_(std::move(settings)), make_policy_(std::move(make_policy)) {}

void Evaluation::begin(EnvHandle& env) {
  Part& part = parts_[&env];
  part.policy = make_policy_(env);
  part.episodes.clear();
  client_.command(env, settings_);
}

std::vector<EnvHandle*> Evaluation::unusable() const {
  std::vector<EnvHandle*> found;
  for (const auto& [env, part] : parts_)
    if (!env->refusal.empty() || (!env->alive() && part.episodes.size() < settings_.tasks())) found.push_back(env);
  return found;
}

bool Evaluation::decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice) {
  parts_.at(&env).policy->act(observation, choice);
  steps_ += choice.size();
  return true;
}

void Evaluation::add(EnvHandle& env, const msg::EpisodeStat& episode) {
  const auto part = parts_.find(&env);
  if (part == parts_.end() || episode.settings() != env.settings.settings() || episode.task() >= settings_.tasks())
    return;
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

void Evaluation::check_alive(double wait) {
  for (auto& [env, part] : parts_) {
    if (env->lost()) {
      const std::string other = client_.other_policy(*env);
      if (other.empty())
        begin(*env);
      else if (wait > 0 && seconds_since(env->heard_other) > wait)
        throw Error("works for policy_service '" + other + "'", "env_service '" + env->id + "'",
                    "wait until that one ends, or evaluate in another --session");
    }
    if (Clock::now() - env->presence.last_heard() > kPatience)
      throw Error("went silent during the evaluation on '" + env->traversal() + "'", "env_service '" + env->id + "'",
                  "start it again, then evaluate the checkpoint with --mode evaluate");
  }
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

void EvaluationRun::load_agent() {
  PolicyServiceOptions& options = context_.options;
  agent_ = trained_agent(read_checkpoint(options.checkpoint));
  if (!agent_->task.turns.empty())
    throw Error("learned a route that crosses itself, and env_services do not announce crossings yet",
                options.checkpoint, "evaluate it in one process (tools/inprocess)");
  if (!options.parameters.empty()) load_parameters(options.parameters, *agent_);
  if (options.max_steps == options.frames) options.max_steps = agent_->task.frames;
  options.agent = agent_->name;
  options.first_frame = agent_->first_frame;
  options.frames = agent_->task.frames;
  options.cap_frames = false;
}

Evaluation::MakePolicy EvaluationRun::agent_policy() const {
  NetworkPolicy::Options options;
  options.seed = mix_seeds({context_.options.seed, kEvaluationChoices});
  return [agent = *agent_, options](const EnvHandle&) { return std::make_unique<NetworkPolicy>(agent, options); };
}

Evaluation::MakePolicy EvaluationRun::control(const std::string& name) {
  PolicyServiceOptions& options = context_.options;
  const auto& entry = ControlRegistry::instance().find("control", name);
  const Parameters parameters(name, entry.parameters, options.control_parameters[name]);
  const ControlTask route{options.first_frame, options.frames};
  if (name != "oracle_filter") {
    ControlTask task = route;
    if (name == "sequence_filter") task.reference = context_.reference();
    return [&entry, parameters, task](const EnvHandle&) { return entry.create(parameters, task); };
  }
  std::map<std::string, ControlTask> tasks;
  for (const EnvHandle* env : context_.evaluation_envs()) {
    const std::vector<float>& features = context_.features_on(env->traversal());
    ControlTask& task = tasks.emplace(env->traversal(), route).first->second;
    task.reference = Eigen::Map<const Matrix<float>>(
        features.data(), static_cast<std::ptrdiff_t>(features.size()) / route.frames, route.frames);
  }
  return
      [&entry, parameters, tasks](const EnvHandle& env) { return entry.create(parameters, tasks.at(env.traversal())); };
}

/// Goes on with another env_service of the same traversal. Returns which silent ones are waited for, as there is none.
std::string EvaluationRun::replace_unusable(Evaluation& evaluation, const std::string& label) {
  std::string awaited;
  for (EnvHandle* env : evaluation.unusable()) {
    EnvHandle* const other = context_.env_on(env->traversal());
    if (!other && env->refusal.empty()) {
      awaited += (awaited.empty() ? "waiting for silent env_services: '" : ", '") + env->id + "'";
      continue;
    }
    evaluation.remove(*env);
    if (other) {
      spdlog::warn("'{}' evaluates {} on '{}' instead of '{}'", other->id, label, env->traversal(), env->id);
      evaluation.begin(*other);
    } else {
      spdlog::error("no evaluation of {} on '{}': its env_service is not used, and there is no other", label,
                    env->traversal());
    }
  }
  return awaited;
}

void EvaluationRun::evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                             const std::vector<EnvHandle*>& envs) {
  const PolicyServiceOptions& options = context_.options;
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.first_frame() = static_cast<std::uint32_t>(options.first_frame);
  settings.frames() = static_cast<std::uint32_t>(options.frames);
  settings.max_steps() = static_cast<std::uint32_t>(options.max_steps);
  settings.tasks() = static_cast<std::uint32_t>(options.tasks);
  settings.seed() = mix_seeds({options.seed, kEvaluationTasks});
  settings.shuffle() = shuffle;
  settings.policy() = name.c_str();
  if (agent_ && name == options.agent) settings.update() = agent_->update;
  settings.run_id() = context_.records.run_id();
  const std::string label = shuffle ? "shuffled" : name;
  Evaluation evaluation(context_.client, settings, make);
  {
    const EvaluationHandlers handlers(context_.client, evaluation);
    const Clock::time_point since = Clock::now();
    for (EnvHandle* env : envs) evaluation.begin(*env);
    context_.node.report(msg::RUNNING, "evaluating " + label);
    std::string waiting;
    while (!evaluation.done()) {
      context_.spin();
      const std::string awaited = replace_unusable(evaluation, label);
      if (awaited != waiting) {
        if (!awaited.empty()) spdlog::warn("{}", awaited);
        context_.node.report(awaited.empty() ? msg::RUNNING : msg::WAITING,
                             awaited.empty() ? "evaluating " + label : awaited);
      }
      waiting = awaited;
      evaluation.check_alive(context_.options.wait);
      const double rate = static_cast<double>(evaluation.steps()) / std::max(1e-9, seconds_since(since));
      context_.progress.show("evaluating " + label, evaluation.fraction(), rate, -1, "");
    }
  }
  context_.progress.finish();
  for (const auto& [traversal, result] : evaluation.scores()) rows_.push_back({label, traversal, result});
}

void EvaluationRun::evaluate_others() {
  std::vector<EnvHandle*> others;
  for (EnvHandle* env : context_.evaluation_envs())
    if (context_.experience_on(env->traversal()) < 0) others.push_back(env);
  if (others.empty()) return;
  evaluate(context_.options.agent, false, agent_policy(), others);
  for (const ScoreRow& row : rows_)
    spdlog::info("update {} on '{}': completed {:.1f} %, SPL {:.3f}", agent_->update, row.traversal,
                 100 * row.score.completed, row.score.spl);
  rows_.clear();
}

void EvaluationRun::evaluate_all() {
  const PolicyServiceOptions& options = context_.options;
  const std::vector<EnvHandle*> envs = context_.evaluation_envs();
  context_.cap_frames(envs);
  if (!context_.records.announced()) context_.records.announce("", 0, {});
  const Evaluation::MakePolicy agent = agent_ ? agent_policy() : control(options.agent);
  evaluate(options.agent, false, agent, envs);
  for (const std::string& name : options.controls) {
    if (name == options.agent) continue;
    if (name == "shuffled") {
      evaluate(options.agent, true, agent, envs);
    } else if (name.ends_with("_filter") && context_.reference().size() == 0) {
      spdlog::warn("skipping {}: traversal '{}' has no features or no env_service", name, joined(options.train));
    } else {
      evaluate(name, false, control(name), envs);
    }
  }
  if (!rows_.empty()) return;
  if (options.mode == "evaluate")
    throw Error("nothing was evaluated", "", "the log says why the env_services that were found are not used");
  spdlog::warn("nothing was evaluated: there is no env_service that is used");
}

}  // namespace citylearn
