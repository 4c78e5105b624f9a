// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

namespace citylearn {

struct AgentReplayOptions {
  std::string bag;                               ///< of ROS 2: its folder, or its only file
  std::vector<std::string> agents;               ///< checkpoints, or output folders of trainings
  std::string output;                            ///< FILE.mcap to write
  int goal = -1;                                 ///< that agents go to, a frame of their route; -1: the last one
  std::uint64_t seed = 1;                        ///< of drawn actions, as policy_service's --seed
  std::map<std::string, std::string> recording;  ///< options of env_service and encoder_service, without dashes
};

/// What one agent did.
struct AgentReplayed {
  std::string name;           ///< "run_1": its topics are /citylearn/run_1/...
  std::vector<double> times;  ///< of its decisions, seconds since 1970
  std::vector<std::uint8_t> actions;
  std::vector<std::uint32_t> likeliest;  ///< places that it believed to stand at; empty without a belief
  std::vector<float> lost;               ///< its probability of being lost; likewise
};

/// Lets agents decide on each picture of a bag, in order and without a clock or a wire: the same bag, agents and
/// options give the same bytes. Each picture is taken to show the next place, as a step forward would. Writes an MCAP
/// file of profile ros2 with the bag's own messages and the decisions, at the time of the pictures:
/// /citylearn/NAME/action (std_msgs/UInt8: 0 stay, 1 next, 2 previous), /citylearn/NAME/place and /citylearn/NAME/lost
/// (std_msgs/Float32). Throws Error naming a file, option or frame, and lab::Stopped; the output is then removed.
std::vector<AgentReplayed> replay_agents(const AgentReplayOptions& options);

/// Returns the stretches of decisions, first and last, in which agents chose other actions than the first one did.
std::vector<std::pair<std::size_t, std::size_t>> partings(const std::vector<AgentReplayed>& agents);

}  // namespace citylearn
