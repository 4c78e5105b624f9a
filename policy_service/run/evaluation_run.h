// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <string>
#include <vector>

#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/results/pairing.h"
#include "policy_service/run/evaluation.h"
#include "policy_service/run/run_context.h"

namespace citylearn {

/// Evaluates the agent of a run and its controls.
class EvaluationRun {
 public:
  /// `context` must outlive it.
  explicit EvaluationRun(RunContext& context) : context_(context) {}

  /// Takes the agent, its route and its step limit from --checkpoint. Throws Error naming the file.
  void load_agent();
  /// Returns the number of features a frame that the agent needs; unset without an agent.
  std::optional<int> feature_dimension() const { return agent_ ? std::optional(agent_->task.features) : std::nullopt; }
  /// Returns what the agent learned from, as far as its checkpoint says.
  TrainingData data() const { return agent_ ? agent_->data : TrainingData(); }
  /// Evaluates this agent from now on.
  void set_agent(TrainedAgent agent) { agent_ = std::move(agent); }

  /// Evaluates the agent on all traversals but those trained on, logs its scores and returns the mean of their SPL;
  /// none without such a traversal. Training environments wait meanwhile, so the training's results are the same with
  /// and without it.
  std::optional<double> evaluate_others();
  /// Evaluates the agent, or the control in its place where there is none, and the controls.
  void evaluate_all();
  const std::vector<ScoreRow>& rows() const { return rows_; }
  /// Returns what each traversal shows of its pairs with the one trained on, if oracle_filter was asked.
  const std::map<std::string, Pairing>& pairings() const { return pairings_; }

 private:
  std::string gather_envs(Evaluation& evaluation, const std::string& label);
  void evaluate(const std::string& name, bool shuffle, const Evaluation::MakePolicy& make,
                const std::vector<std::string>& traversals);
  Evaluation::MakePolicy agent_policy();
  bool remembers() const;
  bool learned_on(const std::string& traversal) const;
  std::vector<std::string> known(const std::string& name, std::vector<std::string> traversals) const;
  Evaluation::MakePolicy control(const std::string& name);
  const Matrix<float>& reference();

  RunContext& context_;
  std::optional<TrainedAgent> agent_;
  std::vector<ScoreRow> rows_;
  std::map<std::string, Pairing> pairings_;
};

}  // namespace citylearn
