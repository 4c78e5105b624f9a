// SPDX-License-Identifier: Apache-2.0
#include "tools/record/agent_replay.h"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <limits>

#include "core/recording/mcap_writer.h"
#include "core/ros2/messages.h"
#include "core/task/action.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "core/util/version.h"
#include "env_service/dataset_io/selection.h"
#include "env_service/ros2/bag.h"
#include "policy_service/network/checkpoint.h"
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

/// Returns a name that ROS 2 allows, and that is not `taken`.
std::string topic_name(const std::string& agent, const std::vector<AgentReplayed>& taken) {
  std::filesystem::path path = std::filesystem::weakly_canonical(agent);
  if (path.extension() == ".clk") path.replace_extension();
  std::string name = path.filename();
  for (char& letter : name)
    if (!std::isalnum(static_cast<unsigned char>(letter))) letter = '_';
  if (name.empty() || !std::isalpha(static_cast<unsigned char>(name.front()))) name = "agent_" + name;
  const auto used = [&](const std::string& one) {
    return std::any_of(taken.begin(), taken.end(), [&](const AgentReplayed& other) { return other.name == one; });
  };
  std::string unique = name;
  for (int number = 2; used(unique); ++number) unique = name + "_" + std::to_string(number);
  return unique;
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

AgentReplayed decide(const AgentReplayOptions& options, TrainedAgent agent, const python::Keywords& keywords) {
  // How the recordings of the training were cut, thinned and aligned says nothing of the bag.
  for (const char* name : {"frames", "metres", "step", "align-to", "align-by", "align-within"})
    agent.data.source.erase(name);
  if (keywords.contains("step") || keywords.contains("step_metres")) agent.data.source.erase("step-metres");
  const Traversal seen = python::load_recording(keywords, agent.data).traversal;
  const int goal = options.goal < 0 ? agent.task.frames - 1 : options.goal;
  if (goal >= agent.task.frames)
    throw Error("is beyond the route of " + std::to_string(agent.task.frames) + " places",
                "--goal " + std::to_string(goal));
  const auto first_frame = static_cast<std::uint32_t>(agent.first_frame);
  NetworkPolicy policy(agent, {.seed = evaluation_choice_seed(options.seed), .greedy = false});
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

/// An MCAP file of profile ros2 with a bag's own messages and what is added.
class BagCopy {
 public:
  explicit BagCopy(const std::string& path)
      : writer_(path, {.library = "citylearn " + version(), .about = {}, .profile = "ros2"}) {}

  template <class Message, class Value>
  void write(const std::string& topic, Value value, std::uint64_t time) {
    const Ros2Type& type = ros2_type_of<Message>();
    Message message;
    message.data(value);
    encode_ros2(message, bytes_);
    write({topic, type.name, "ros2msg", type.schema, "cdr"}, time, bytes_);
  }
  void write(McapChannel channel, std::uint64_t time, std::span<const std::byte> data) {
    std::uint16_t& number = channels_[{channel.topic, channel.type}];
    if (number == 0) {
      channel.metadata = {{"offered_qos_profiles", ""}};  // rosbag2 asks for them; none given are its default
      number = writer_.add(channel);
    }
    writer_.write(number, time, data);
  }
  void close() { writer_.close(); }

 private:
  McapWriter writer_;
  std::map<std::pair<std::string, std::string>, std::uint16_t> channels_;  // by topic and type
  Bytes bytes_;
};

/// Writes the decisions until a time, from the `next` one of each agent on.
void write_until(BagCopy& copy, const std::vector<AgentReplayed>& agents, std::vector<std::size_t>& next,
                 double until) {
  for (std::size_t a = 0; a < agents.size(); ++a) {
    const AgentReplayed& agent = agents[a];
    const std::string prefix = "/citylearn/" + agent.name + "/";
    for (std::size_t& i = next[a]; i < agent.actions.size() && agent.times[i] <= until; ++i) {
      const auto time = static_cast<std::uint64_t>(std::llround(1e9 * agent.times[i]));
      copy.write<std_msgs::msg::dds_::UInt8_>(prefix + "action", agent.actions[i], time);
      if (agent.likeliest.empty()) continue;
      copy.write<std_msgs::msg::dds_::Float32_>(prefix + "place", static_cast<float>(agent.likeliest[i]), time);
      copy.write<std_msgs::msg::dds_::Float32_>(prefix + "lost", agent.lost[i], time);
    }
  }
}

}  // namespace

std::vector<AgentReplayed> replay_agents(const AgentReplayOptions& options) {
  const std::filesystem::path output = std::filesystem::weakly_canonical(options.output);
  if (output.parent_path() == std::filesystem::weakly_canonical(options.bag))
    throw Error("would become a part of the bag", "--output " + options.output, "write it elsewhere");
  BagCopy copy(options.output);
  try {
    const python::Keywords keywords = keywords_of(options);
    std::vector<AgentReplayed> agents;
    for (const std::string& agent : options.agents) {
      AgentReplayed done = decide(options, trained_agent(read_checkpoint(checkpoint_of(agent))), keywords);
      done.name = topic_name(agent, agents);
      agents.push_back(std::move(done));
    }
    std::vector<std::size_t> next(agents.size());
    Bag bag(options.bag);
    bag.read_all([](const BagTopic&) { return true; },
                 [&](const BagMessage& message) {
                   write_until(copy, agents, next, 1e-9 * static_cast<double>(message.time));
                   BagTopic topic = bag.topics()[message.topic];
                   if (const Ros2Type* type = ros2_type(topic.type); type && topic.schema.empty())
                     topic.schema_encoding = "ros2msg", topic.schema = type->schema;
                   copy.write({topic.name, topic.type, topic.schema_encoding, topic.schema, topic.encoding},
                              message.time, message.data);
                 });
    write_until(copy, agents, next, std::numeric_limits<double>::infinity());
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
