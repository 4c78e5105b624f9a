// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <memory>
#include <span>
#include <vector>

#include "core/util/random.h"
#include "policy_service/network/agent_network.h"
#include "policy_service/network/checkpoint/trained_agent.h"
#include "policy_service/network/feature_normaliser.h"
#include "policy_service/rollout/evaluated_tasks.h"
#include "policy_service/rollout/policy.h"

namespace citylearn {

/// Draws an allowed action from masked logits, with one number of `random`; `log_probability` gets its logarithm.
std::uint8_t sample_action(const Eigen::Ref<const Eigen::Vector3f>& logits, Random& random, float& log_probability);

/// Adds what each agent believes in its state, a column of `states`, to an empty message. Adds nothing for a network
/// without a belief.
void add_beliefs(const AgentNetwork<float>& network, const Matrix<float>& states, int first_frame, msg::Belief& belief,
                 const StateMap* streets);

/// Fills `inputs` (one step, the agents of `who`; empty: all) from an observation of a route of `frames` places from
/// `first_frame` on. A column of EvaluatedTasks::kNobody shows nothing. With `own` every agent gets features of its
/// own, for the caller to change; else agents that are shown the same frame share them. The traversal is this
/// `experience` of the route. Throws Error naming the field when the observation has another number of features or
/// agents, or a frame off the route.
void read_observation(const msg::Observation& observation, const NetworkTask& task, int first_frame, int frames,
                      bool own, NetworkInputs<float>& inputs, std::span<const int> who = {}, int experience = 0);

/// Acts from fixed parameters and keeps the recurrent state along each episode. Idle agents cost little.
class NetworkPolicy : public Policy {
 public:
  struct Options {
    std::uint64_t seed = 1;  ///< of the drawn actions, with the task
    bool greedy = false;     ///< take the likeliest action instead of drawing one
  };
  NetworkPolicy(TrainedAgent agent, const Options& options);

  void begin(std::uint32_t first_task, const SeenFeatures& known) override { tasks_.begin(first_task, known); }
  /// Throws Error when the observation does not fit the agent (see read_observation).
  void act(const msg::Observation& observation, std::vector<std::uint8_t>& choice) override;
  void believe(msg::Belief& belief) const override;
  std::map<std::uint32_t, SeenFeatures> seen() const override { return tasks_.seen(); }

 private:
  void act(const msg::Observation& observation, const EvaluatedTasks::Batch& batch, std::vector<std::uint8_t>& choice);

  TrainedAgent agent_;
  Options options_;
  FeatureNormaliser normaliser_;
  EvaluatedTasks tasks_;
  std::vector<Random> random_;  // by agent, of its task
  NetworkInputs<float> inputs_;
  Matrix<float> states_, state_;  // of all agents, of a batch
  std::unique_ptr<Workspace<float>> workspace_;
};

}  // namespace citylearn
