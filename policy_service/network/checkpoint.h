// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "policy_service/network/agent_network.h"

namespace citylearn {

/// Everything a training run needs to go on, and everything an agent needs to act. One file: magic, version, JSON
/// header, tensors (little-endian floats, column-major), SHA-256 of all that. The same contents give the same bytes.
struct Checkpoint {
  nlohmann::json header;                         ///< agent, parameters, task, counters ... (Trainer::checkpoint)
  std::map<std::string, Matrix<float>> tensors;  ///< "learner.parameters", "learner.adam.first", "reference" ...
};

/// Leaves either the whole file or what was there before (see write_file). Throws Error naming the file.
void write_checkpoint(const std::string& path, const Checkpoint& checkpoint);

/// Throws Error naming the file when it is no checkpoint, of a newer program, cut short or damaged.
Checkpoint read_checkpoint(const std::string& path);

/// Writes `folder`/checkpoint-<update>.clk (making the folder), then removes all but the newest `keep`. Returns the
/// path. Throws Error naming the file; the old ones are then all still there.
std::string write_checkpoint_of_update(const std::string& folder, std::uint64_t update, const Checkpoint& checkpoint,
                                       int keep = 3);

/// The one of the latest update; none when the folder has no checkpoint or does not exist.
std::optional<std::string> newest_checkpoint(const std::string& folder);

/// An agent that acts and learns no more.
struct TrainedAgent {
  std::string name;     ///< of its network
  NetworkTask task;     ///< what it was built for
  int first_frame = 0;  ///< where the route of its places begins on the traversal
  std::shared_ptr<const AgentNetwork<float>> network;
  Vector<float> parameters;
  std::uint64_t update = 0;  ///< of the learner, that made the parameters
};

/// The agent in a checkpoint. Throws Error when the header lacks something or this program does not know the network.
TrainedAgent trained_agent(const Checkpoint& checkpoint);

}  // namespace citylearn
