// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <string>

#include "policy_service/network/agent_network.h"
#include "training_data.h"

namespace citylearn {

struct Checkpoint;

/// An agent that acts and no longer learns.
struct TrainedAgent {
  std::string name;     ///< of its network
  NetworkTask task;     ///< that the network was built for
  int first_frame = 0;  ///< where the route of its places begins on the traversal
  std::shared_ptr<const AgentNetwork<float>> network;
  Vector<float> parameters;
  std::uint64_t update = 0;                               ///< of the learner that made the parameters
  TrainingData data;                                      ///< that it learned from; older checkpoints do not say
  int places = 0;                                         ///< of the streets that it learned on; 0: of a line
  std::map<std::string, double> network_parameters = {};  ///< as a checkpoint has them

  /// Builds the network for a task. An agent that learned on streets walks on any others too.
  void build_network(NetworkTask on);
  /// Builds it for streets. `reference`: features of theirs, as NetworkTask has them.
  void build_network(std::shared_ptr<const StateMap> streets, const Matrix<float>& reference, float goal_radius);
};

/// Returns the agent in a checkpoint. Throws Error when the header is incomplete or the network unknown, or when it
/// learned on streets and its network needs their map: a checkpoint has none.
TrainedAgent trained_agent(const Checkpoint& checkpoint);
/// Returns the same without its network, which build_network() makes.
TrainedAgent unbuilt_agent(const Checkpoint& checkpoint);

}  // namespace citylearn
