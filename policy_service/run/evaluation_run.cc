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

}  // namespace

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
  ControlTask task{options.first_frame, options.frames, 0, {}};
  if (name == "sequence_filter") {
    task.reference = context_.reference();
    task.dimension = static_cast<int>(task.reference.size()) / options.frames;
  }
  return [&entry, parameters, task](const EnvHandle&) { return entry.create(parameters, task); };
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
  Evaluation evaluation(context_.client, envs, settings, make);
  {
    const EvaluationHandlers handlers(context_.client, evaluation);
    const Clock::time_point since = Clock::now();
    for (EnvHandle* env : envs) evaluation.begin(*env);
    context_.node.report(msg::RUNNING, "evaluating " + label);
    while (!evaluation.done()) {
      context_.spin();
      evaluation.check_alive();
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
    if (env->traversal() != context_.options.train) others.push_back(env);
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
  if (!context_.records.announced()) context_.records.announce("", 0, {});
  const Evaluation::MakePolicy agent = agent_ ? agent_policy() : control(options.agent);
  evaluate(options.agent, false, agent, envs);
  for (const std::string& name : options.controls) {
    if (name == options.agent) continue;
    if (name == "shuffled") {
      evaluate(options.agent, true, agent, envs);
    } else if (name == "sequence_filter" && context_.reference().empty()) {
      spdlog::warn("skipping sequence_filter: traversal '{}' has no features or no env_service", options.train);
    } else {
      evaluate(name, false, control(name), envs);
    }
  }
}

}  // namespace citylearn
