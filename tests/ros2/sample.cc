// SPDX-License-Identifier: Apache-2.0
// ros2_sample FILE.mcap: a recording (citylearn record), and FILE.mcap.json, which says what its conversion must have.
#include <fstream>
#include <iostream>
#include <limits>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "core/exchange/object.h"
#include "core/task/training_figures.h"
#include "core/util/error.h"
#include "tests/support/records/recordings.h"

namespace {

using namespace citylearn;
using namespace citylearn::testing;
using Json = nlohmann::json;

constexpr std::uint64_t kBegin = 1'700'000'000'900'000'000, kStep = 100'000'000;
constexpr std::uint64_t kHash = 0x1234;
constexpr std::uint32_t kFrames = 12, kUnknown = 5, kWithoutPicture = 7;
constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

class Sample {
 public:
  explicit Sample(const std::string& path) : tape_(path) {}

  /// An expected message; NaN is said as null.
  void expect(const std::string& topic, const std::string& type, std::uint64_t time, const Json& fields) {
    expected_.push_back(
        {{"topic", "/citylearn/" + topic}, {"type", type}, {"time", std::to_string(time)}, {"fields", fields}});
  }
  template <class Message>
  void say(Message& message, const std::string& sender, std::uint64_t time) {
    message.header().protocol(msg::PROTOCOL);
    message.header().session("demo");
    message.header().sender(sender.c_str());
    message.header().incarnation(77);
    tape_.say(message, time);
  }

  template <class Chunk>
  void say_object(const ObjectKey& key, const auto& object, std::uint64_t time) {
    const ObjectBytes bytes(key, encode_object(object));
    Chunk chunk;
    chunk.receiver("dashboard");
    for (std::uint32_t index = 0; index < bytes.chunks(); ++index) {
      bytes.fill(index, chunk);
      say(chunk, "env-summer", time);
    }
  }

  void map() {
    msg::RouteMap map;
    for (std::uint32_t frame = 0; frame < kFrames; ++frame) {
      map.position().push_back(position(frame));
      map.latitude().push_back(latitude(frame));
      map.longitude().push_back(frame == kUnknown ? kNan : 10.5);
    }
    say_object<msg::RouteMapChunk>({kHash, 0, 0}, map, kBegin + 3 * kStep);
  }

  /// Pictures come after the observations of their frames, some as JPEG and some as PNG.
  void pictures() {
    for (std::uint32_t frame = 0; frame < kFrames; ++frame) {
      if (frame == kWithoutPicture) continue;
      msg::Image image;
      image.file() = picture(frame);
      say_object<msg::ImageChunk>({kHash, 0, frame}, image, kBegin + 9 * kStep);
    }
  }

  void walk() {
    for (std::uint32_t step = 0; step < 9; ++step) {
      const std::uint64_t time = kBegin + step * kStep;
      msg::Observation seen;
      seen.traversal("summer");
      seen.traversal_hash(kHash);
      seen.settings().incarnation(5);
      seen.settings().version(1);
      seen.step(step);
      seen.frame({step, 3});
      seen.position({step, 3});
      seen.goal({11, 0});
      seen.previous_action({kNext, kStay});
      seen.allowed({7, 7});
      // The second agent has nothing to do after the first steps.
      seen.flags({0, step < 2 ? std::uint8_t{0} : msg::FLAG_IDLE});
      seen.reward({0.25f * static_cast<float>(step), -1});
      say(seen, "env-summer", time);
      say(seen, "env-summer", time + kStep + 1);  // sent again, in time for the next one
      msg::Action action;
      action.environment("env-summer");
      action.environment_incarnation(77);
      action.settings(seen.settings());
      action.step(step);
      const std::uint8_t choice = static_cast<std::uint8_t>(step % 3);
      action.choice({choice, kNoAction});
      say(action, "policy", time + 1000);
      say(action, "policy", time + 2000);  // sent again

      see(0, step, 11, seen.reward()[0], time);
      if (step < 2) see(1, 3, 0, -1, time);
      expect("env_summer/agent_0/action", "std_msgs/msg/UInt8", time + 1000, {{"data", choice}});
      expect("env_summer/agent_0/cmd_vel", "geometry_msgs/msg/Twist", time + 1000,
             {{"linear",
               {{"x", choice == kNext       ? 0.5
                      : choice == kPrevious ? -0.5
                                            : 0.0},
                {"y", 0},
                {"z", 0}}},
              {"angular", {{"x", 0}, {"y", 0}, {"z", 0}}}});
    }
  }

  void results() {
    msg::EpisodeStat stat;
    stat.steps(8);
    stat.shortest(4);
    stat.reward(0.5f);
    stat.completed(true);
    for (std::uint64_t episode = 1; episode <= 3; ++episode) {
      stat.log().number(episode);
      stat.log().first(1);
      stat.agent(episode == 2 ? 200 : 0);  // the second one is of an agent that is not shown
      if (episode == 3) stat.completed(false);
      const std::uint64_t time = kBegin + (20 + episode) * kStep;
      say(stat, "env-summer", time);
      say(stat, "env-summer", time + 1);
      if (episode == 2) continue;
      expect("env_summer/agent_0/episode/reward", "std_msgs/msg/Float32", time, {{"data", 0.5}});
      expect("env_summer/agent_0/episode/spl", "std_msgs/msg/Float32", time, {{"data", episode == 1 ? 0.5 : 0.0}});
    }
    msg::TrainingStat update;
    update.log().stream(9);
    update.log().number(1);
    update.log().first(1);
    update.update(1);
    update.reward(kNan);  // before the first episode
    update.spl(0.75f);
    say(update, "policy", kBegin + 30 * kStep);
    say(update, "policy", kBegin + 31 * kStep);
    for (const TrainingFigure& figure : training_figures())
      if (std::string(figure.name) != "reward")
        expect(std::string("policy/training/") + figure.name, "std_msgs/msg/Float64", kBegin + 30 * kStep,
               {{"data", figure.value(update)}});
  }

  void write_expected(const std::string& path) const { std::ofstream(path + ".json") << expected_; }

 private:
  static float position(std::uint32_t frame) { return frame == kUnknown ? kNan : 2.5f * static_cast<float>(frame); }
  static double latitude(std::uint32_t frame) { return frame == kUnknown ? kNan : 67 + 1e-5 * frame; }
  static std::vector<std::uint8_t> picture(std::uint32_t frame) {
    std::vector<std::uint8_t> file;
    cv::imencode(frame % 2 ? ".png" : ".jpg", cv::Mat(24, 32, CV_8UC3, cv::Scalar::all(20 * frame)), file);
    return file;
  }
  static Json header(const std::string& frame_id, std::uint64_t time) {
    return {{"stamp", {{"sec", time / 1'000'000'000}, {"nanosec", time % 1'000'000'000}}}, {"frame_id", frame_id}};
  }
  void see(int agent, std::uint32_t frame, std::uint32_t goal, float reward, std::uint64_t time) {
    const std::string name = "env_summer/agent_" + std::to_string(agent);
    expect(name + "/reward", "std_msgs/msg/Float32", time, {{"data", reward}});
    for (const auto& [prefix, place] : {std::pair{"/", frame}, {"/goal_", goal}}) {
      if (place == kUnknown) continue;
      expect(name + prefix + "pose", "geometry_msgs/msg/PoseStamped", time,
             {{"header", header("citylearn/env_summer/route", time)},
              {"pose",
               {{"position", {{"x", position(place)}, {"y", 0}, {"z", 0}}},
                {"orientation", {{"x", 0}, {"y", 0}, {"z", 0}, {"w", 1}}}}}});
      expect(name + prefix + "fix", "sensor_msgs/msg/NavSatFix", time,
             {{"header", header("citylearn/" + name, time)},
              {"status", {{"status", 0}, {"service", 1}}},
              {"latitude", latitude(place)},
              {"longitude", 10.5},
              {"altitude", nullptr},
              {"position_covariance", std::vector<double>(9)},
              {"position_covariance_type", 0}});
    }
    if (frame == kWithoutPicture) return;
    expect(name + "/image/compressed", "sensor_msgs/msg/CompressedImage", time,
           {{"header", header("citylearn/" + name + "/camera", time)},
            {"format", frame % 2 ? "png" : "jpeg"},
            {"data", picture(frame)}});
  }

  Tape tape_;
  Json expected_ = Json::array();
};

}  // namespace

int main(int argc, char** argv) try {
  if (argc != 2) throw Error("needs FILE.mcap");
  Sample sample(argv[1]);
  sample.walk();
  sample.map();
  sample.pictures();
  sample.results();
  sample.write_expected(argv[1]);
} catch (const std::exception& error) {
  std::cerr << "ros2_sample: " << error.what() << "\n";
  return 1;
}
