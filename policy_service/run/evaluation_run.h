// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "policy_service/network/checkpoint.h"
#include "policy_service/records/score.h"
#include "policy_service/rollout/policy.h"
#include "policy_service/run/run_context.h"

namespace citylearn {

/// Performs all tasks of `settings` (mode EVALUATE) on several env_services at once. The same seed gives every policy
/// the very same tasks, on whichever traversal. Used by one thread.
class Evaluation {
 public:
  using MakePolicy = std::function<std::unique_ptr<Policy>(const EnvHandle&)>;

  /// `client` must outlive it.
  Evaluation(EnvClient& client, msg::TaskSettings settings, MakePolicy make_policy);

  /// Sends the settings to an env_service; call once for each. One that restarts begins again from its first task: call
  /// again for it.
  void begin(EnvHandle& env);
  /// Returns the env_services that are refused by now, and those that are silent before their last task is done.
  std::vector<EnvHandle*> unusable() const;
  void remove(EnvHandle& env) { parts_.erase(&env); }
  /// Chooses actions, as EnvClient::Decide.
  bool decide(EnvHandle& env, const msg::Observation& observation, std::vector<std::uint8_t>& choice);
  /// Takes in a finished episode; repetitions and those of other settings are ignored.
  void add(EnvHandle& env, const msg::EpisodeStat& episode);

  bool done() const;
  /// Returns the fraction of tasks finished, 0..1.
  double fraction() const;
  std::uint64_t steps() const { return steps_; }
  /// Begins again on env_services that were taken by a policy_service that has ended. Throws Error when one has been
  /// silent for half a minute, or works for another policy_service for `wait` seconds (0: for ever).
  void check_alive(double wait);
  bool includes(EnvHandle& env) const { return parts_.contains(&env); }
  /// Returns the scores by traversal, in the order of the tasks.
  std::map<std::string, Score> scores() const;

 private:
  struct Part {
    std::unique_ptr<Policy> policy;
    std::map<std::uint32_t, msg::EpisodeStat> episodes;  ///< by task
  };
  EnvClient& client_;
  const msg::TaskSettings settings_;
  MakePolicy make_policy_;
  std::map<EnvHandle*, Part, ById> parts_;
  std::uint64_t steps_ = 0;
};

/// Lets an evaluation handle the messages of its env_services while it lives; other ones go where they went before.
class EvaluationHandlers {
 public:
  EvaluationHandlers(EnvClient& client, Evaluation& evaluation);
  ~EvaluationHandlers();
  EvaluationHandlers(const EvaluationHandlers&) = delete;
  EvaluationHandlers& operator=(const EvaluationHandlers&) = delete;

 private:
  EnvClient& client_;
  const EnvClient::Decide decide_;
  const EnvClient::Finished finished_;
  const EnvClient::Joined joined_;
};

/// Evaluates the agent of a run and its controls.
class EvaluationRun {
 public:
  /// `context` must outlive it.
  explicit EvaluationRun(RunContext& context) : context_(context) {}

  /// Takes the agent, its route and its step limit from --checkpoint. Throws Error naming the file.
  void load_agent();
  /// Returns the number of features a frame that the agent needs; unset without an agent.
  std::optional<int> feature_dimension() const { return agent_ ? std::optional(agent_->task.features) : std::nullopt; }
  /// Evaluates this agent from now on.
  void set_agent(TrainedAgent agent) { agent_ = std::move(agent); }

  /// Evaluates the agent on all traversals but those trained on and logs its scores. Training environments wait
  /// meanwhile, so the training's results are the same with and without it.
  void evaluate_others();
  /// Evaluates the agent, or the control in its place where there is none, and the controls.
  void evaluate_all();
  const std::vector<ScoreRow>& rows() const { return rows_; }

 private:
  std::string replace_unusable(Evaluation& evaluation, const std::string& label);
  void evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                const std::vector<EnvHandle*>& envs);
  Evaluation::MakePolicy agent_policy() const;
  Evaluation::MakePolicy control(const std::string& name);

  RunContext& context_;
  std::optional<TrainedAgent> agent_;
  std::vector<ScoreRow> rows_;
};

}  // namespace citylearn
