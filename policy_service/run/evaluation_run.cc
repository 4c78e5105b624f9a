// SPDX-License-Identifier: Apache-2.0
#include "policy_service/run/evaluation_run.h"

#include <spdlog/spdlog.h>

#include <algorithm>

#include "core/exchange/timing.h"
#include "policy_service/interchange/safetensors.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/rollout/control.h"
#include "policy_service/rollout/network_policy.h"

namespace citylearn {

namespace {

bool given(const PolicyServiceOptions& options, const std::string& name) {
  return std::any_of(options.configuration.begin(), options.configuration.end(),
                     [&](const OptionValue& option) { return option.name == name && option.origin != kDefaultOrigin; });
}

}  // namespace

void EvaluationRun::load_agent() {
  PolicyServiceOptions& options = context_.options;
  agent_ = unbuilt_agent(read_checkpoint(options.checkpoint));
  const bool on_streets = agent_->places > 0;  // its network is built for those of each env_service
  if (!on_streets) agent_->build_network(agent_->task);
  if (!agent_->data.known())
    spdlog::warn("{}: the checkpoint does not say what its agent learned from, so the data are not checked",
                 options.checkpoint);
  else if (!given(options, "--train"))
    options.train = agent_->data.names();
  if (!options.parameters.empty() && on_streets)
    throw Error("is for agents on a line, that of " + options.checkpoint + " walks on streets", "--parameters");
  if (!options.parameters.empty()) load_parameters(options.parameters, *agent_);
  if (options.cap_steps) options.max_steps = agent_->task.frames;
  options.agent = agent_->name;
  options.first_frame = agent_->first_frame;
  options.cap_frames = on_streets;
  if (!on_streets) options.frames = agent_->task.frames;
}

Evaluation::MakePolicy EvaluationRun::agent_policy() {
  NetworkPolicy::Options options;
  options.seed = evaluation_choice_seed(context_.options.seed);
  const bool on_streets = agent_->places > 0;
  return [agent = *agent_, on_streets, known = on_streets ? reference() : Matrix<float>(),
          radius = context_.options.goal_radius, options](const EnvHandle& env) {
    if (on_streets != env.on_streets())
      throw Error(on_streets ? "is a line, the agent learned on streets" : "has streets, the agent learned on a line",
                  "traversal '" + env.traversal() + "'");
    if (!on_streets || env.streets == agent.task.streets) return std::make_unique<NetworkPolicy>(agent, options);
    if (agent.data.known() && agent.data.traversals.front().streets_hash != env.info.streets_hash())
      spdlog::info("'{}' has other streets than '{}', where the agent learned", env.traversal(),
                   agent.data.traversals.front().traversal);
    TrainedAgent one = agent;
    one.build_network(env.streets, known, radius);
    return std::make_unique<NetworkPolicy>(std::move(one), options);
  };
}

/// Returns whether the agent goes by the features of --train, and not by those that its checkpoint has.
bool EvaluationRun::remembers() const {
  const PolicyServiceOptions& options = context_.options;
  return agent_ ? agent_->places > 0 && given(options, "--train") : options.agent == "sequence_filter";
}

/// Returns whether the agent learned on the streets of a traversal, so that it remembers them by itself.
bool EvaluationRun::learned_on(const std::string& traversal) const {
  return agent_ && agent_->data.known() &&
         agent_->data.traversals.front().streets_hash == context_.envs_on(traversal).front()->info.streets_hash();
}

/// Returns those of the traversals on whose streets an agent or a control of this name can walk: a filter remembers one
/// map's places.
std::vector<std::string> EvaluationRun::known(const std::string& name, std::vector<std::string> traversals) const {
  if (name != "sequence_filter" && !(agent_ && agent_->places > 0 && name == context_.options.agent)) return traversals;
  const auto remembered = context_.streets_on(context_.options.train.front());
  std::erase_if(traversals, [&](const std::string& traversal) {
    const EnvHandle* env = context_.env_on(traversal);
    if (!env || !env->streets || env->streets == remembered || (!remembered && learned_on(traversal))) return false;
    spdlog::warn("skipping {} on '{}': {}", name, traversal,
                 remembered ? "its streets are not those of --train"
                            : "no env_service has --train's streets; start one on " + context_.options.train.front());
    return true;
  });
  return traversals;
}

/// Returns the features that filters remember: those of --train, else those that the agent does.
const Matrix<float>& EvaluationRun::reference() {
  const Matrix<float>& hosted = context_.reference();
  return hosted.size() == 0 && agent_ ? agent_->task.reference : hosted;
}

Evaluation::MakePolicy EvaluationRun::control(const std::string& name) {
  PolicyServiceOptions& options = context_.options;
  const auto& entry = ControlRegistry::instance().find("control", name);
  const Parameters parameters(name, entry.parameters, options.control_parameters[name]);
  const auto task_on = [route = ControlTask{options.first_frame, options.frames},
                        radius = options.goal_radius](const EnvHandle& env) {
    ControlTask task = route;
    task.streets = env.streets;
    task.goal_radius = radius;
    if (env.streets) task.frames = env.streets->states();
    return task;
  };
  if (name != "oracle_filter") {
    const Matrix<float>* taught = name == "sequence_filter" ? &reference() : nullptr;
    return [&entry, parameters, task_on, taught](const EnvHandle& env) {
      ControlTask task = task_on(env);
      if (taught) task.reference = *taught;
      return entry.create(parameters, task);
    };
  }
  std::map<std::string, ControlTask> tasks;
  const Matrix<float>& taught = reference();
  for (const EnvHandle* env : context_.evaluation_envs(remembers())) {
    const std::vector<float>& features = context_.features_on(env->traversal());
    ControlTask& task = tasks.emplace(env->traversal(), task_on(*env)).first->second;
    task.reference = Eigen::Map<const Matrix<float>>(
        features.data(), static_cast<std::ptrdiff_t>(features.size()) / task.frames, task.frames);
    if (!task.streets) pairings_[env->traversal()] = examine_pairs(taught, task.reference);
  }
  return
      [&entry, parameters, tasks](const EnvHandle& env) { return entry.create(parameters, tasks.at(env.traversal())); };
}

/// Lets all env_services take part that can, and goes on without those that no longer can. Returns which silent ones
/// are waited for, as their traversals have no other. Throws Error when one has been silent for half a minute, or works
/// for another policy_service for --wait.
std::string EvaluationRun::gather_envs(Evaluation& evaluation, const std::string& label) {
  std::map<std::string, int> open = evaluation.open();
  for (EnvHandle* env : evaluation.envs()) {
    const auto found = open.find(env->traversal());
    if (found == open.end() || (env->usable() && !env->lost())) continue;
    if (env->refusal.empty() && !env->lost() && found->second == 1) continue;  // it may come back
    --found->second;
    evaluation.remove(*env);
    if (found->second > 0) spdlog::warn("others evaluate {} on '{}' instead of '{}'", label, found->first, env->id);
  }
  std::string awaited;
  for (const auto& [traversal, count] : open) {
    for (EnvHandle* env : context_.envs_on(traversal))
      if (!evaluation.includes(*env)) evaluation.add(*env);
    const EnvHandle* missing = nullptr;
    bool any = false;
    for (const auto& [id, env] : context_.client.envs()) {
      if (env->traversal() != traversal || !env->refusal.empty()) continue;
      if (evaluation.includes(*env) && env->usable()) any = true;
      missing = env.get();
    }
    if (any) continue;
    if (!missing) {
      spdlog::error("no evaluation of {} on '{}': its env_service is not used, and there is no other", label,
                    traversal);
      evaluation.drop(traversal);
      continue;
    }
    const std::string other = context_.client.other_policy(*missing);
    const double wait = context_.options.wait;
    if (!other.empty() && wait > 0 && seconds_since(missing->heard_other) > wait)
      throw Error("works for policy_service '" + other + "'", "env_service '" + missing->id + "'",
                  "wait until that one ends, or evaluate in another --session");
    if (Clock::now() - missing->presence.last_heard() > kCommandGiveUp)
      throw Error("went silent during the evaluation on '" + traversal + "'", "env_service '" + missing->id + "'",
                  "start it again, then evaluate the checkpoint with --mode evaluate");
    if (!missing->alive())
      awaited += (awaited.empty() ? "waiting for silent env_services: '" : ", '") + missing->id + "'";
  }
  return awaited;
}

void EvaluationRun::evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                             const std::vector<std::string>& traversals) {
  const PolicyServiceOptions& options = context_.options;
  msg::TaskSettings settings;
  settings.task_mode() = msg::EVALUATE;
  settings.first_frame() = static_cast<std::uint32_t>(options.first_frame);
  settings.frames() = static_cast<std::uint32_t>(options.frames);
  settings.max_steps() = options.cap_steps ? 0 : static_cast<std::uint32_t>(options.max_steps);  // 0: as many as frames
  settings.max_detour() = static_cast<std::uint32_t>(options.max_detour);
  settings.goal_radius() = options.goal_radius;
  settings.tasks() = static_cast<std::uint32_t>(options.tasks);
  settings.seed() = evaluation_task_seed(options.seed);
  settings.shuffle() = shuffle;
  settings.policy() = name.c_str();
  if (agent_ && name == options.agent) settings.update() = agent_->update;
  settings.run_id() = context_.records.run_id();
  const std::string label = shuffle ? "shuffled" : name;
  Evaluation evaluation(context_.client, settings, make, traversals);
  {
    const EvaluationHandlers handlers(context_.client, evaluation);
    const Clock::time_point since = Clock::now();
    context_.node.report(msg::RUNNING, "evaluating " + label);
    std::string waiting;
    while (!evaluation.done()) {
      const std::string awaited = gather_envs(evaluation, label);
      if (awaited != waiting) {
        if (!awaited.empty()) spdlog::warn("{}", awaited);
        context_.node.report(awaited.empty() ? msg::RUNNING : msg::WAITING,
                             awaited.empty() ? "evaluating " + label : awaited);
      }
      waiting = awaited;
      context_.spin();
      const double rate = static_cast<double>(evaluation.steps()) / std::max(1e-9, seconds_since(since));
      context_.progress.show("evaluating " + label, evaluation.fraction(), rate, -1, "");
    }
  }
  context_.progress.finish();
  for (const auto& [traversal, result] : evaluation.scores()) rows_.push_back({label, traversal, result});
}

std::optional<double> EvaluationRun::evaluate_others() {
  std::vector<std::string> others;
  for (const EnvHandle* env : context_.evaluation_envs(remembers()))
    if (context_.experience_on(env->traversal()) < 0) others.push_back(env->traversal());
  others = known(context_.options.agent, std::move(others));
  if (others.empty()) return std::nullopt;
  evaluate(context_.options.agent, false, agent_policy(), others);
  double sum = 0;
  for (const ScoreRow& row : rows_) {
    sum += row.score.spl;
    spdlog::info("update {} on '{}': completed {:.1f} %, SPL {:.3f}", agent_->update, row.traversal,
                 100 * row.score.completed, row.score.spl);
  }
  const auto count = static_cast<double>(rows_.size());
  rows_.clear();
  return count > 0 ? std::optional(sum / count) : std::nullopt;
}

void EvaluationRun::evaluate_all() {
  const PolicyServiceOptions& options = context_.options;
  const std::vector<EnvHandle*> envs = context_.evaluation_envs(remembers());
  context_.fit_route(envs);
  std::vector<std::string> traversals;
  for (const EnvHandle* env : envs) traversals.push_back(env->traversal());
  if (!context_.records.announced()) context_.records.announce("", 0, {});
  const Evaluation::MakePolicy agent = agent_ ? agent_policy() : control(options.agent);
  evaluate(options.agent, false, agent, known(options.agent, traversals));
  for (const std::string& name : options.controls) {
    if (name == options.agent) continue;
    if (name == "shuffled" && !traversals.empty() && context_.streets_on(traversals.front())) {
      spdlog::warn("skipping shuffled: the frames of streets are not shuffled");
    } else if (name == "shuffled") {
      evaluate(options.agent, true, agent, traversals);
    } else if (name.ends_with("_filter") && reference().size() == 0) {
      spdlog::warn("skipping {}: traversal '{}' has no features or no env_service", name, joined(options.train));
    } else {
      evaluate(name, false, control(name), known(name, traversals));
    }
  }
  if (!rows_.empty()) return;
  if (options.mode == "evaluate")
    throw Error("nothing was evaluated", "", "the log says why the env_services that were found are not used");
  spdlog::warn("nothing was evaluated: there is no env_service that is used");
}

}  // namespace citylearn
