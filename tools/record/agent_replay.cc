// SPDX-License-Identifier: Apache-2.0
#include "tools/record/agent_replay.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <set>

#include "core/recording/ros2_bag_writer.h"
#include "core/ros2/messages.h"
#include "core/ros2/name.h"
#include "core/task/action.h"
#include "core/util/error.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/ros2/bag.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/rollout/network_policy.h"
#include "policy_service/run/evaluation.h"
#include "python/options.h"
#include "ros2/ros2.h"

namespace citylearn {
namespace {

/// Returns the file of a checkpoint, which may be named by the training's folder.
std::string checkpoint_of(const std::string& agent) {
  return std::filesystem::is_directory(agent) ? agent + "/checkpoints/" + kBestCheckpoint : agent;
}

/// Returns what an agent is called: "taught" of runs/taught, "best" of best.clk.
std::string name_of(const std::string& agent) {
  const std::filesystem::path path = std::filesystem::weakly_canonical(agent);
  return path.extension() == ".clk" ? path.stem() : path.filename();
}

/// Returns the options under which an agent sees the bag: those given; all frames unless they choose.
python::Keywords keywords_of(const AgentReplayOptions& options) {
  python::Keywords keywords = {{"dataset", "rosbag2"}, {"data", options.bag}, {"store", "none"}};
  for (const auto& [given, value] : options.recording) {
    std::string name = given;
    std::replace(name.begin(), name.end(), '-', '_');
    keywords[name] = value;
  }
  Source source;
  source.dataset = "rosbag2";
  source.folder = options.bag;
  const std::vector<std::string> names = open_dataset(source)->names();
  if (names.size() != 1)
    throw Error("holds " + std::to_string(names.size()) + " bags", options.bag, "name one of them");
  keywords["traversal"] = names.front();
  keywords.try_emplace("frames", "0:");
  return keywords;
}

/// Returns the bag as an agent sees it that learned from `learned`.
Traversal seen_by(TrainingData learned, const python::Keywords& keywords) {
  // How the recordings of the training were cut, thinned and aligned says nothing of the bag.
  for (const char* name : {"frames", "metres", "step", "align-to", "align-by", "align-within"})
    learned.source.erase(name);
  if (keywords.contains("step") || keywords.contains("step_metres")) learned.source.erase("step-metres");
  return python::load_recording(keywords, learned).traversal;
}

int goal_of(const AgentReplayOptions& options, const TrainedAgent& agent) {
  if (options.goal >= agent.task.places())
    throw Error("is beyond the route of " + std::to_string(agent.task.places()) + " places",
                "--goal " + std::to_string(options.goal));
  return options.goal < 0 ? agent.task.places() - 1 : options.goal;
}

AgentReplayed decide(const TrainedAgent& agent, int goal, std::uint64_t seed, const Traversal& seen) {
  const auto first_frame = static_cast<std::uint32_t>(agent.first_frame);
  NetworkPolicy policy(agent, {.seed = evaluation_choice_seed(seed), .greedy = false});
  AgentReplayed done;
  done.times = seen.times;
  // Where the robot really is, nobody knows: an agent that looks at its place instead of at pictures sees the first.
  msg::Observation observation;
  observation.traversal(seen.name);
  observation.feature_dimension() = static_cast<std::uint32_t>(seen.dimension);
  observation.frame() = observation.position() = {first_frame};
  observation.goal() = {first_frame + static_cast<std::uint32_t>(goal)};
  observation.allowed() = {(1u << kActions) - 1};
  observation.reward() = {0.0f};
  std::vector<std::uint8_t> choice;
  for (int frame = 0; frame < seen.frames; ++frame) {
    observation.step() = static_cast<std::uint64_t>(frame);
    observation.flags() = {static_cast<std::uint8_t>(frame == 0 ? msg::FLAG_FIRST : 0)};
    observation.previous_action() = {static_cast<std::uint8_t>(frame == 0 ? kNoAction : kNext)};
    observation.features().assign(seen.feature(frame).begin(), seen.feature(frame).end());
    policy.act(observation, choice);
    done.actions.push_back(choice.at(0));
    msg::Belief belief;
    policy.believe(belief);
    if (belief.likely().empty()) continue;
    done.likeliest.push_back(belief.likely()[0] - first_frame);
    done.lost.push_back(belief.lost()[0]);
  }
  return done;
}

/// Writes the decisions of one agent into a bag, in order.
class Decisions {
 public:
  Decisions(Ros2BagWriter& bag, const AgentReplayed& agent) : bag_(bag), agent_(agent) {
    action_ = add<Action>("action");
    if (agent.likeliest.empty()) return;
    place_ = add<Believed>("place");
    lost_ = add<Believed>("lost");
  }
  /// Writes those until a time, in seconds.
  void write_until(double until) {
    for (; next_ < agent_.actions.size() && agent_.times[next_] <= until; ++next_) {
      const auto time = static_cast<std::uint64_t>(std::llround(1e9 * agent_.times[next_]));
      write<Action>(action_, agent_.actions[next_], time);
      if (agent_.likeliest.empty()) continue;
      write<Believed>(place_, static_cast<float>(agent_.likeliest[next_]), time);
      write<Believed>(lost_, agent_.lost[next_], time);
    }
  }

 private:
  using Action = std_msgs::msg::dds_::UInt8_;
  using Believed = std_msgs::msg::dds_::Float32_;

  template <class Message>
  std::uint16_t add(const std::string& name) {
    return bag_.add("/citylearn/" + agent_.name + "/" + name, ros2_type_of<Message>());
  }
  template <class Message, class Value>
  void write(std::uint16_t channel, Value value, std::uint64_t time) {
    Message message;
    message.data(value);
    encode_ros2(message, bytes_);
    bag_.write(channel, time, bytes_);
  }

  Ros2BagWriter& bag_;
  const AgentReplayed& agent_;
  std::uint16_t action_ = 0, place_ = 0, lost_ = 0;  // channels
  std::size_t next_ = 0;
  Bytes bytes_;
};

/// Adds a bag's topic to another bag, with the definition and the hash that the first one may lack.
std::uint16_t add_topic(Ros2BagWriter& bag, const BagTopic& topic) {
  const Ros2Type* type = topic.encoding == "cdr" ? ros2_type(topic.type) : nullptr;
  if (type && topic.schema.empty()) return bag.add(topic.name, *type);
  const std::string hash = type ? type->hash : "";
  return bag.add(
      {topic.name, topic.type, topic.schema_encoding, topic.schema, topic.encoding, {{"topic_type_hash", hash}}});
}

}  // namespace

std::vector<AgentReplayed> replay_agents(const AgentReplayOptions& options) {
  const std::filesystem::path output = std::filesystem::weakly_canonical(options.output);
  if (output.parent_path() == std::filesystem::weakly_canonical(options.bag))
    throw Error("would become a part of the bag", "--output " + options.output, "write it elsewhere");
  Ros2BagWriter copy(options.output);
  try {
    const python::Keywords keywords = keywords_of(options);
    std::vector<AgentReplayed> agents;
    std::map<std::string, Traversal> seen;  // by what agents learned from: those of one training see the same
    std::set<std::string> taken;
    for (const std::string& name : options.agents) {
      const TrainedAgent agent = trained_agent(read_checkpoint(checkpoint_of(name)));
      const int goal = goal_of(options, agent);
      const std::string learned = agent.data.text();
      if (!seen.contains(learned)) seen[learned] = seen_by(agent.data, keywords);
      agents.push_back(decide(agent, goal, options.seed, seen[learned]));
      agents.back().name = ros2_name(name_of(name), "agent_", taken);
    }
    std::vector<Decisions> decisions;
    for (const AgentReplayed& agent : agents) decisions.emplace_back(copy, agent);
    const auto write_until = [&](double until) {
      for (Decisions& one : decisions) one.write_until(until);
    };
    std::vector<std::uint16_t> channels;  // by topic of the bag; 0: not added yet
    Bag bag(options.bag);
    bag.read_all([](const BagTopic&) { return true; },
                 [&](const BagMessage& message) {
                   write_until(1e-9 * static_cast<double>(message.time));
                   channels.resize(bag.topics().size());
                   std::uint16_t& channel = channels[message.topic];
                   if (channel == 0) channel = add_topic(copy, bag.topics()[message.topic]);
                   copy.write(channel, message.time, message.data);
                 });
    write_until(std::numeric_limits<double>::infinity());
    copy.close();
    return agents;
  } catch (...) {
    std::filesystem::remove(options.output);
    throw;
  }
}

std::vector<std::pair<std::size_t, std::size_t>> partings(const std::vector<AgentReplayed>& agents) {
  std::vector<std::pair<std::size_t, std::size_t>> found;
  for (std::size_t i = 0; i < agents.front().actions.size(); ++i) {
    const bool agree = std::all_of(agents.begin(), agents.end(), [&](const AgentReplayed& agent) {
      return i < agent.actions.size() && agent.actions[i] == agents.front().actions[i];
    });
    if (agree) continue;
    if (found.empty() || found.back().second + 1 != i) found.emplace_back(i, i);
    found.back().second = i;
  }
  return found;
}

}  // namespace citylearn
