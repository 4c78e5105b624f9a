// SPDX-License-Identifier: Apache-2.0
#include "tools/record/agent_replay.h"

#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "core/recording/mcap_writer.h"
#include "core/ros2/header.h"
#include "core/ros2/messages.h"
#include "core/task/action.h"
#include "core/util/error.h"
#include "encoder_service/encoder_options.h"
#include "encoder_service/pipeline/learned_files.h"
#include "env_service/dataset_io/dataset.h"
#include "policy_service/network/checkpoint/checkpoint.h"
#include "policy_service/network/checkpoint/training_data.h"
#include "python/options.h"
#include "ros2/ros2.h"
#include "tests/support/files.h"
#include "tests/support/text.h"
#include "tools/lab/descriptors.h"
#include "tools/lab/training.h"

namespace citylearn::testing {
namespace {

constexpr int kFrames = 24;
constexpr std::uint64_t kBegin = 1'790'000'000'000'000'000, kInterval = 100'000'000;

/// A route in the drawn city, an agent that learned on it, and a bag of a drive along it: picture i shows place i.
class AgentReplay : public ::testing::Test {
 protected:
  AgentReplay() {
    const auto& synthetic = DatasetRegistry::instance().find("dataset", "synthetic");
    const auto city = synthetic.create(Parameters("synthetic", synthetic.parameters, {{"frames", kFrames}}), "");
    const Traversal summer = city->load("summer");
    std::filesystem::create_directories(folder_ / "route/summer");
    McapWriter bag(folder_ / "drive.mcap", {"test", {}, 1 << 20, kInterval, "ros2"});
    const auto add = [&]<class Message>(const std::string& topic, Message) {
      const Ros2Type& type = ros2_type_of<Message>();
      return bag.add({topic, type.name, "ros2msg", type.schema, "cdr"});
    };
    sensor_msgs::msg::dds_::CompressedImage_ image;
    std_msgs::msg::dds_::String_ note;
    const std::uint16_t camera = add("/camera", image), notes = add("/note", note);
    Bytes bytes;
    for (int frame = 0; frame < kFrames; ++frame) {
      const std::string path = folder_ / ("route/summer/" + std::to_string(100 + frame) + ".png");
      cv::imwrite(path, lab::read_picture(summer, frame));
      const std::string file = contents(path);
      const std::uint64_t time = kBegin + kInterval * static_cast<std::uint64_t>(frame);
      image.header(ros2_header("front", time));
      image.format("png");
      image.data().assign(file.begin(), file.end());
      encode_ros2(image, bytes);
      bag.write(camera, time + 7, bytes);
      note.data("note");
      encode_ros2(note, bytes);
      bag.write(notes, time + 9, bytes);
    }
    bag.close();
    train();
    options_.bag = folder_ / "drive.mcap";
    options_.agents = {folder_ / "trained"};
    options_.output = folder_ / "out.mcap";
  }

  /// Writes trained/checkpoints/best.clk.
  void train() {
    const std::map<std::string, std::string> source = {
        {"data", folder_ / "route"}, {"dataset", "plain"}, {"encoder", "patchnorm"}, {"reference", "summer"}};
    python::Keywords keywords(source.begin(), source.end());
    keywords["store"] = "none";
    const Traversal seen = python::load_recording(keywords).traversal;
    const auto& plain = DatasetRegistry::instance().find("dataset", "plain");
    const std::uint64_t hash =
        plain.create(Parameters("plain", plain.parameters, {}), folder_ / "route")->load("summer").hash();
    const auto& encoder = EncoderRegistry::instance().find("encoder", "patchnorm");
    const FeatureRecipe recipe{encoder.create(Parameters("patchnorm", encoder.parameters, {}), {})->spec().name,
                               recipe_of(reduction_for("patchnorm", {})), hash};
    InprocessTraining training(TrainerOptions(), seen, kFrames);
    for (int update = 0; update < 30; ++update) training.update();
    Checkpoint checkpoint = training.trainer().checkpoint();
    TrainingData data;
    data.traversals = {{"summer", hash, static_cast<std::uint32_t>(seen.dimension), recipe.text(), "plain", kFrames}};
    data.source = source;
    checkpoint.header["data"] = nlohmann::json::parse(data.text());
    std::filesystem::create_directories(folder_ / "trained/checkpoints");
    write_checkpoint(folder_ / "trained/checkpoints/best.clk", checkpoint);
  }

  Folder folder_;
  AgentReplayOptions options_;
};

/// To place 12 it goes forwards from the places before, and back from those behind.
TEST_F(AgentReplay, DecidesOnEachPictureTheSameTwice) {
  options_.goal = 12;
  const std::vector<AgentReplayed> agents = replay_agents(options_);
  ASSERT_EQ(agents.size(), 1u);
  const AgentReplayed& agent = agents[0];
  EXPECT_EQ(agent.name, "trained");
  ASSERT_EQ(agent.actions.size(), std::size_t{kFrames});
  EXPECT_NEAR(agent.times[10], 1'790'000'001, 1e-6);
  for (std::size_t i = 4; i < 12; ++i) {
    EXPECT_EQ(agent.actions[i], kNext) << i;
    EXPECT_EQ(agent.likeliest.at(i), i);
    EXPECT_LT(agent.lost.at(i), .1);
  }
  EXPECT_EQ(agent.actions[16], kPrevious);

  std::map<std::string, int> count;
  McapReader reader(options_.output);
  while (const auto message = reader.next()) {
    ++count[message->channel->topic];
    EXPECT_FALSE(message->channel->schema.empty());
  }
  EXPECT_EQ(count, (std::map<std::string, int>{{"/camera", 24},
                                               {"/note", 24},
                                               {"/citylearn/trained/action", 24},
                                               {"/citylearn/trained/place", 24},
                                               {"/citylearn/trained/lost", 24}}));
  EXPECT_EQ(reader.profile(), "ros2");
  const std::string first = contents(options_.output);
  options_.output = folder_ / "again.mcap";
  replay_agents(options_);
  EXPECT_EQ(first, contents(options_.output));
}

TEST_F(AgentReplay, ComplainsInOneLineAndLeavesNoFile) {
  const auto complaint = [&] { return error_of([&] { replay_agents(options_); }); };
  options_.goal = kFrames;
  EXPECT_EQ(complaint(), "--goal 24: is beyond the route of 24 places");
  options_.goal = -1;
  options_.recording = {{"rosbag2-camera", "2"}};
  EXPECT_NE(complaint().find("--rosbag2-camera 2"), std::string::npos) << complaint();
  options_.recording = {{"rosbag2-camra", "1"}};
  EXPECT_NE(complaint().find("rosbag2_camra"), std::string::npos) << complaint();
  options_.recording.clear();
  options_.bag = folder_ / "bags";
  std::filesystem::create_directory(options_.bag);
  std::filesystem::copy(folder_ / "drive.mcap", options_.bag + "/a.mcap");
  std::filesystem::copy(folder_ / "drive.mcap", options_.bag + "/b.mcap");
  EXPECT_NE(complaint().find("holds 2 bags"), std::string::npos) << complaint();
  EXPECT_FALSE(std::filesystem::exists(options_.output));
  options_.output = options_.bag + "/out.mcap";
  EXPECT_EQ(complaint(), "--output " + options_.output + ": would become a part of the bag (write it elsewhere)");
  EXPECT_FALSE(std::filesystem::exists(options_.output));
}

TEST(AgentReplays, PartWhereOneChoosesOtherwise) {
  AgentReplayed one, other;
  one.actions = {1, 1, 2, 2, 1, 0};
  other.actions = {1, 2, 1, 2, 1, 1};
  EXPECT_EQ(partings({one, other}), (std::vector<std::pair<std::size_t, std::size_t>>{{1, 2}, {5, 5}}));
  EXPECT_TRUE(partings({one, one}).empty());
}

}  // namespace
}  // namespace citylearn::testing
