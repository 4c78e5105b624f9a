// SPDX-License-Identifier: Apache-2.0
// What a node of ROS 2 hears of an agent, over either vendor (node.c).
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/support/data/pictures.h"
#include "tests/support/env/scripted_policy.h"
#include "tests/support/processes/keystore.h"
#include "tests/support/processes/trial.h"
#include "tests/support/records/recordings.h"

namespace citylearn::testing {
namespace {

using Json = nlohmann::json;

constexpr int kFrames = 24;

double latitude(int frame) { return 67 + 1e-4 * frame; }

/// Pictures and where they were taken; returns the files.
std::vector<std::string> write_route(const std::string& folder) {
  std::vector<std::string> pictures;
  std::filesystem::create_directories(folder + "/summer");
  std::ofstream poses(folder + "/summer.poses.csv");
  poses.precision(17);
  poses << "lat,lon\n";
  for (int frame = 0; frame < kFrames; ++frame) {
    const std::string file = folder + "/summer/" + std::to_string(frame) + ".jpg";
    write_grey(file, 10 * frame);
    pictures.push_back(contents(file));
    poses << latitude(frame) << ",10.5\n";
  }
  return pictures;
}

std::string bytes_of_hex(const std::string& text) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 2)
    bytes += static_cast<char>(std::stoi(text.substr(i, 2), nullptr, 16));
  return bytes;
}

/// A bridge between an agent that walks and a node that hears it.
class Ros2Bridges : public VendorTest {
 protected:
  void start_bridge(const Arguments& options) { bridge_ = trial_.program(CITYLEARN_ROS2, "ros2", options); }
  /// Lets the agents walk until `condition` holds, and ends the bridge.
  void walk_until(const std::function<bool()>& condition) {
    Arguments options = {"--dataset", "plain", "--data", trial_.folder() / "data"};
    MiddlewareOptions middleware = trial_.middleware();
    if (keys_) {
      options.insert(options.end(), {"--security", keys_->add("env_service", "env-summer")});
      middleware.security = keys_->add("policy_service", "policy");
    }
    const auto env = trial_.env("summer", options);
    ScriptedPolicy policy(middleware, "default", "env-summer");
    ShortestPath walker;
    policy.walker = &walker;
    msg::TaskSettings settings;
    settings.task_mode(msg::TRAIN);
    settings.frames(kFrames);
    settings.max_steps(4 * kFrames);
    ASSERT_TRUE(policy.until([&] { return policy.infos > 0; })) << env->output();
    policy.command(settings);
    EXPECT_TRUE(policy.until(condition, seconds(60) * kSlowness)) << bridge_->output() << env->output();
    EXPECT_EQ(bridge_->end(SIGTERM, seconds(10)), 0) << bridge_->output();
  }
  /// Starts `program` as a node and walks until it ends, which is right where it has heard enough.
  void walk_until_heard(const char* program, const Arguments& of_node, const Arguments& of_bridge) {
    const std::string domain = std::to_string(own_domain());
    const Arguments node = {program, domain, "60", "/citylearn/env_summer/agent_0"};
    node_ = std::make_unique<Service>(node + of_node, trial_.folder() / "node.log");
    ASSERT_TRUE(node_->says("subscribed", seconds(20))) << node_->output();
    const Arguments options = {"--actions", "--ros-middleware", GetParam(), "--ros-domain", domain, "--speed", ".5"};
    start_bridge(options + of_bridge);
    std::optional<int> status;
    walk_until([&] { return (status = node_->wait(milliseconds(0))).has_value(); });
    ASSERT_EQ(status, 0) << node_->output() << bridge_->output();
  }

  Trial trial_{GetParam()};
  std::optional<Keystore> keys_;  // of a secured session
  const std::vector<std::string> pictures_ = write_route(trial_.folder() / "data");
  std::unique_ptr<Service> node_, bridge_;
};
CITYLEARN_EACH_VENDOR(Ros2Bridges);

TEST_P(Ros2Bridges, NodesWithDefaultSettingsHearThem) {
  for (const auto& [program, more] :
       {std::pair<const char*, Arguments>{ROS2_FASTDDS_NODE, {}}, {ROS2_NODE, {"default"}}}) {
    walk_until_heard(program, more, {});
    EXPECT_FALSE(contains(node_->output(), "messages of")) << node_->output();
  }
}

TEST_P(Ros2Bridges, ASecuredSessionIsHeardToo) {
  keys_.emplace();
  walk_until_heard(ROS2_NODE, {}, {"--ros-interface", "lo", "--security", keys_->add("ros2_bridge", "ros2_bridge")});
  EXPECT_FALSE(contains(node_->output(), "messages of")) << node_->output();
  EXPECT_TRUE(contains(bridge_->output(), "ROS 2's is not encrypted")) << bridge_->output();
}

TEST_P(Ros2Bridges, RecordsWhatAnAgentSees) {
  const std::string file = trial_.folder() / "ros2.mcap";
  start_bridge({"--output", file});
  ASSERT_TRUE(bridge_->says("records to", seconds(20))) << bridge_->output();
  std::map<std::string, int> counts;
  const auto enough = [&] {
    counts.clear();
    for (const Heard& heard : all_of(file)) ++counts[heard.topic.substr(heard.topic.find("agent_"))];
    // Places come a little later than pictures, once the map is here.
    return counts["agent_0/image/compressed"] >= 10 && counts["agent_0/pose"] >= 10 &&
           counts["agent_0/goal_fix"] >= 10 && counts["agent_0/episode/spl"] > 0;
  };
  walk_until(enough);
  EXPECT_EQ(counts.size(), 7u) << "neither rewards nor actions, and one agent alone";
  std::string missing;
  all_of(file, &missing);
  EXPECT_EQ(missing, "");
  EXPECT_TRUE(contains(bridge_->output(), "/citylearn/env_summer/agent_0/goal_fix")) << bridge_->output();
  Trial other(GetParam());
  const auto again = other.program(CITYLEARN_ROS2, "ros2", {"--output", file});
  EXPECT_EQ(again->wait(seconds(20)), 1);
  EXPECT_TRUE(contains(again->output(), "is there already")) << again->output();
}

TEST_P(Ros2Bridges, ANodeHearsWhatAnAgentSeesAndDoes) {
  ASSERT_NO_FATAL_FAILURE(walk_until_heard(ROS2_NODE, {}, {"--ros-interface", "lo"}));
  std::map<std::string, std::vector<Json>> heard;  // by topic, and once more for sensor data
  std::map<std::string, Json> writers;
  std::istringstream lines(node_->output());
  for (std::string line; std::getline(lines, line);) {
    ASSERT_TRUE(line.starts_with("{")) << line;
    const Json said = Json::parse(line);
    if (said.contains("writer")) writers[said["writer"]] = said;
    if (said.contains("topic"))
      heard[said["topic"].get<std::string>() + (said["sensor_data"].get<bool>() ? " sensor_data" : "")].push_back(said);
  }

  const std::map<std::string, std::string> types = {{"image/compressed", "sensor_msgs::msg::dds_::CompressedImage_"},
                                                    {"pose", "geometry_msgs::msg::dds_::PoseStamped_"},
                                                    {"goal_pose", "geometry_msgs::msg::dds_::PoseStamped_"},
                                                    {"fix", "sensor_msgs::msg::dds_::NavSatFix_"},
                                                    {"cmd_vel", "geometry_msgs::msg::dds_::Twist_"},
                                                    {"action", "std_msgs::msg::dds_::UInt8_"},
                                                    {"reward", "std_msgs::msg::dds_::Float32_"}};
  EXPECT_EQ(writers.size(), types.size());
  for (const auto& [name, type] : types) {
    const Json& writer = writers["rt/citylearn/env_summer/agent_0/" + name];
    ASSERT_TRUE(writer.is_object()) << name;
    EXPECT_EQ(writer["type"], type);
    EXPECT_EQ(writer["reliable"], true) << name;
    EXPECT_EQ(writer["volatile"], true) << name;
  }
  EXPECT_EQ(heard.size(), 8u);
  for (const auto& [name, messages] : heard) EXPECT_GE(messages.size(), 10u) << name;

  // Pictures are those of the places where the agent stood when they were taken.
  std::map<std::pair<int, unsigned>, int> frames;  // by stamp
  for (const char* name : {"image/compressed", "image/compressed sensor_data"})
    for (const Json& image : heard[name]) {
      EXPECT_EQ(image["format"], "jpeg");
      EXPECT_EQ(image["frame_id"], "citylearn/env_summer/agent_0/camera");
      const auto found = std::find(pictures_.begin(), pictures_.end(), bytes_of_hex(image["data"]));
      ASSERT_NE(found, pictures_.end());
      frames[{image["sec"], image["nanosec"]}] = static_cast<int>(found - pictures_.begin());
    }
  int compared = 0;
  for (const Json& fix : heard["fix sensor_data"])
    if (const auto frame = frames.find({fix["sec"], fix["nanosec"]}); frame != frames.end()) {
      EXPECT_EQ(fix["latitude"], latitude(frame->second));
      EXPECT_EQ(fix["longitude"], 10.5);
      ++compared;
    }
  for (const Json& pose : heard["pose"])
    if (const auto frame = frames.find({pose["sec"], pose["nanosec"]}); frame != frames.end()) {
      EXPECT_NEAR(pose["x"], 11.13 * frame->second, .05 * frame->second) << "metres along the route";
      EXPECT_EQ(pose["w"], 1);
      ++compared;
    }
  EXPECT_GE(compared, 10);
  for (const Json& pose : heard["goal_pose"]) EXPECT_LE(pose["x"], 11.2 * kFrames);
  for (const Json& action : heard["action"]) EXPECT_TRUE(action["data"] == kNext || action["data"] == kPrevious);
  for (const Json& twist : heard["cmd_vel"]) EXPECT_EQ(std::abs(twist["x"].get<double>()), .5);
  for (const Json& reward : heard["reward"]) EXPECT_TRUE(std::isfinite(reward["data"].get<double>()));
}

TEST(Ros2Sessions, ThatThereIsNoEnvServiceIsSaid) {
  Trial trial("cyclonedds");
  const auto bridge = trial.program(CITYLEARN_ROS2, "ros2", {"--output", trial.folder() / "ros2.mcap"});
  EXPECT_TRUE(bridge->says("no env_service yet in session '", seconds(20))) << bridge->output();
  EXPECT_EQ(bridge->end(SIGTERM, seconds(10)), 0) << bridge->output();
}

TEST(Ros2Conversions, WhatStandsBeforeADamageIsConverted) {
  Trial trial("cyclonedds");
  const std::string recording = trial.folder() / "damaged.mcap", file = trial.folder() / "ros2.mcap";
  {
    Tape tape(recording);
    msg::TrainingStat update;
    update.header().protocol(msg::PROTOCOL);
    update.header().session("demo");
    update.header().sender("policy");
    for (std::uint64_t number = 1; number <= 5'000; ++number) {
      update.log().number(number);
      update.log().first(1);
      update.update(number);
      tape.say(update, 1'000'000 * number);
    }
  }
  std::fstream bytes(recording, std::ios::in | std::ios::out | std::ios::binary);
  bytes.seekp(static_cast<std::streamoff>(std::filesystem::file_size(recording) / 2));
  bytes << std::string(100, 'x') << std::flush;
  const auto converted = trial.program(CITYLEARN_ROS2, "ros2", {"--open", recording, "--output", file});
  EXPECT_EQ(converted->wait(seconds(20)), 1);
  EXPECT_TRUE(contains(converted->output(), "is damaged")) << converted->output();
  EXPECT_TRUE(contains(converted->output(), file + " has only what came before that")) << converted->output();
  EXPECT_GT(all_of(file).size(), 1000u);
}

TEST(Ros2Conversions, NothingIsLeftOfWhatCannotBeConverted) {
  Trial trial("cyclonedds");
  const std::string file = trial.folder() / "ros2.mcap", cut = trial.folder() / "cut.mcap";
  std::ofstream(cut) << "no recording";
  for (const std::string& recording : {cut, std::string(trial.folder() / "none.mcap")}) {
    const auto converted = trial.program(CITYLEARN_ROS2, "ros2", {"--open", recording, "--output", file});
    EXPECT_EQ(converted->wait(seconds(20)), 1);
    EXPECT_TRUE(contains(converted->output(), recording + ": ")) << converted->output();
    EXPECT_FALSE(std::filesystem::exists(file));
  }
}

}  // namespace
}  // namespace citylearn::testing
