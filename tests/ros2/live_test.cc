// SPDX-License-Identifier: Apache-2.0
// Teach and repeat: a robot of another vendor, in other seasons, with wheels that slip and messages that are lost.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <nlohmann/json.hpp>

#include "core/ros2/participant.h"
#include "core/util/text.h"
#include "ros2/ros2.h"
#include "tests/support/data/pictures.h"
#include "tests/support/processes/trial.h"

namespace citylearn::testing {
namespace {

constexpr int kGoals = 12;  // of each robot

class TeachAndRepeat : public VendorTest {
 protected:
  /// Options of ROS 2's side. Pictures and commands of one look have topics of their own.
  Arguments nodes(const std::string& loses = "") const {
    const std::string other = std::string(GetParam()) == "fastdds" ? "cyclonedds" : "fastdds";
    return {"--ros-domain", std::to_string(ros_domain_), "--ros-interface", "lo", "--ros-middleware", loses + other};
  }
  std::unique_ptr<Service> start(const std::string& program, const std::string& name, const Arguments& options) {
    return std::make_unique<Service>(Arguments{program} + options, trial_.folder() / (name + ".log"));
  }
  /// Options of an env_service on the taught route, whose robot has these topics.
  Arguments taught(const std::string& camera, const std::string& pose) const {
    return Arguments{"--dataset", "live", "--data", trial_.folder() / "route", "--agents", "1"} +
           Arguments{"--camera", camera, "--position", pose, "--position-type", "pose"};
  }
  std::unique_ptr<Service> robot(const std::string& look, const Arguments& more) {
    const Arguments drive = {"--look", look, "--metres", "88", "--rate", "20"},
                    topics = {"--camera",  "/" + look + "/camera/compressed",
                              "--pose",    "/" + look + "/pose",
                              "--cmd-vel", "/" + look + "/cmd_vel"};
    return start(CITYLEARN_ROBOT, "robot-" + look, drive + topics + more);
  }
  std::unique_ptr<Service> live(const std::string& look,
                                const std::string& loses = "lossy,drop=0.05:", const Arguments& more = {}) {
    const Arguments route = {"--as", "live-" + look, "--cmd-vel", "/" + look + "/cmd_vel"};
    const Arguments drive = {"--command", "/" + look + "/command", "--speed", "15", "--settle", "0.05"};
    return trial_.env("summer", taught("/" + look + "/camera/compressed", "/" + look + "/pose") + route + drive +
                                    nodes(loses) + more);
  }
  void teach() {
    const Arguments route = {"--output", trial_.folder() / "route", "--traversal", "summer", "--spacing", "3.5"};
    const Arguments topics = {"--camera",     "/summer/camera/compressed", "--position",
                              "/summer/pose", "--position-type",           "pose"};
    const auto teacher = start(CITYLEARN_TEACH, "teach", route + topics + nodes());
    ASSERT_TRUE(teacher->says("listens to", seconds(20))) << teacher->output();
    const auto driven = robot("summer", nodes() + Arguments{"--drive", "10"});
    EXPECT_EQ(driven->wait(seconds(60)), 0) << driven->output();
    EXPECT_EQ(teacher->end(SIGTERM, seconds(5)), 0) << teacher->output();
  }

  Trial trial_{GetParam()};
  const std::uint32_t ros_domain_ = own_domain();
};
CITYLEARN_EACH_VENDOR(TeachAndRepeat);

TEST_P(TeachAndRepeat, TaughtInSummerItArrivesInFallAndRain) {
  ASSERT_NO_FATAL_FAILURE(teach());
  const auto summer = trial_.env("summer", {"--dataset", "plain", "--data", trial_.folder() / "route"});
  auto encoder = trial_.encoder({"--reference", "summer"});
  const auto training = trial_.train(40, "out", {"--place_filter-slip", "0.2"});
  ASSERT_EQ(training->wait(kLongWait), 0) << training->output() << encoder->output();

  std::vector<std::unique_ptr<Service>> robots, lives;
  Arguments more = nodes();
  more.insert(more.end(), {"--slip", "0.2", "--lost", "0.05", "--repeated", "0.05", "--late", "0.05"});
  for (const char* look : {"fall", "rain"}) {
    robots.push_back(robot(look, more));
    lives.push_back(live(look));
  }
  const auto policy = trial_.policy({"--mode", "evaluate", "--checkpoint", trial_.folder() / "out/checkpoints/best.clk",
                                     "--evaluate", "live-fall,live-rain", "--tasks", std::to_string(kGoals),
                                     "--max-steps", "60", "--output", trial_.folder() / "repeat"});
  ASSERT_TRUE(lives[0]->says("evaluation tasks 2..3", kLongWait)) << lives[0]->output() << policy->output();
  encoder->send(SIGKILL);  // on the way
  ASSERT_TRUE(policy->says("encoder_service 'encoder', which encodes for it, is silent", kLongWait))
      << policy->output();
  encoder = trial_.encoder({"--reference", "summer"});
  ASSERT_EQ(policy->wait(3 * kLongWait), 0) << policy->output() << lives[0]->output() << lives[1]->output()
                                            << encoder->output() << robots[0]->output() << robots[1]->output();
  const auto summary = nlohmann::json::parse(contents(trial_.folder() / "repeat/summary.json"));
  ASSERT_EQ(summary["evaluate"].size(), 2u) << summary;
  double arrived = 0;
  for (const auto& [traversal, result] : summary["evaluate"].items()) {
    EXPECT_EQ(result["tasks"], kGoals) << traversal;
    arrived += kGoals * result["completed"].get<double>();
  }
  EXPECT_GE(arrived, 0.95 * 2 * kGoals) << summary << lives[0]->output() << lives[1]->output();
}

/// A node that sends a robot to goals and hears what becomes of them.
class Operator {
 public:
  Operator(const std::string& vendor, std::uint32_t domain, const std::filesystem::path& poses)
      : ros_(middleware_options(vendor, domain), "operator", nullptr),
        status_(ros_.subscribe<std_msgs::msg::dds_::String_>("/status", Profile::kRos2Reliable)) {
    ros_.advertise<Pose>("/goal_pose");
    std::ifstream file(poses);
    std::string line, x, y;
    std::getline(file, line);
    EXPECT_EQ(line, "file,x,y,time");
    while (std::getline(file, line, ',') && std::getline(file, x, ',') && std::getline(file, y, ',')) {
      places_.emplace_back(std::stod(x), std::stod(y));
      std::getline(file, line);
    }
  }
  void send_to(double x, double y) {
    Pose pose;
    pose.header().frame_id("map");
    pose.pose().position().x(x);
    pose.pose().position().y(y);
    ros_.publish("/goal_pose", pose);
  }
  void send_to(int place) {
    const auto [x, y] = places_.at(static_cast<std::size_t>(place));
    send_to(x, y);
  }
  /// Sends it to a place again and again, as the first messages between two that have just met may be lost, until this
  /// is said.
  bool sends_until(int place, const std::string& status) {
    for (int times = 0; times < 60; ++times) {
      send_to(place);
      if (hears(status, seconds(1))) return true;
    }
    return false;
  }
  /// Waits until this is said.
  bool hears(const std::string& status, seconds most = seconds(60)) {
    const auto end = Clock::now() + most;
    for (std_msgs::msg::dds_::String_ message; Clock::now() < end; ros_.wait(Clock::now() + milliseconds(50)))
      while (status_.take(message)) {
        if (heard_.empty() || heard_.back() != message.data()) heard_.push_back(message.data());
        if (message.data() == status) return true;
      }
    return false;
  }
  std::string heard() const { return joined(heard_); }

 private:
  using Pose = geometry_msgs::msg::dds_::PoseStamped_;

  Ros2Participant ros_;
  Ros2Subscription<std_msgs::msg::dds_::String_> status_;
  std::vector<std::pair<double, double>> places_;
  std::vector<std::string> heard_;
};

TEST_P(TeachAndRepeat, NodesSendItToGoals) {
  ASSERT_NO_FATAL_FAILURE(teach());
  const auto summer = trial_.env("summer", {"--dataset", "plain", "--data", trial_.folder() / "route"});
  const auto encoder = trial_.encoder({"--reference", "summer"});
  const auto driven = robot("summer", nodes());
  const auto env = live("summer", "", {"--goal", "/goal_pose", "--status", "/status"});
  Operator person(GetParam(), ros_domain_, trial_.folder() / "route/summer.poses.csv");
  ASSERT_TRUE(person.hears("stopped")) << env->output();
  EXPECT_TRUE(person.sends_until(5, "refused")) << "nobody drives";
  const auto policy =
      trial_.policy({"--mode", "evaluate", "--agent", "shortest_path", "--evaluate", "live-summer", "--frames", "0:20",
                     "--tasks", "4", "--max-steps", "60", "--output", trial_.folder() / "repeat"});
  ASSERT_TRUE(person.hears("waiting")) << env->output() << policy->output();
  person.send_to(5);
  EXPECT_TRUE(person.hears("driving 5")) << env->output();
  EXPECT_TRUE(person.hears("arrived 5")) << env->output();
  for (const double x : {1e4, std::nan(""), HUGE_VAL}) {
    person.send_to(x, 0);
    EXPECT_TRUE(person.hears("refused")) << x << " is not on the route, or nowhere";
    EXPECT_TRUE(person.hears("waiting")) << person.heard();
  }
  person.send_to(5);
  EXPECT_TRUE(person.hears("arrived 5")) << "it stands there";
  person.send_to(18);
  EXPECT_TRUE(person.hears("driving 18")) << person.heard() << env->output();
  person.send_to(2);
  EXPECT_TRUE(person.hears("replaced 18")) << person.heard() << env->output();
  EXPECT_TRUE(person.hears("arrived 2")) << person.heard() << env->output();
  person.send_to(3);
  EXPECT_TRUE(person.hears("arrived 3")) << person.heard() << env->output();
  ASSERT_EQ(policy->wait(kLongWait), 0) << policy->output() << env->output();
  const auto summary = nlohmann::json::parse(contents(trial_.folder() / "repeat/summary.json"));
  EXPECT_EQ(summary["evaluate"]["live-summer"]["completed"], 0.75) << summary;
}

// The camera shows another city. Then the robot is carried to the beginning of the route that it was taught.
TEST_P(TeachAndRepeat, StandsWhileItIsLost) {
  ASSERT_NO_FATAL_FAILURE(teach());
  const auto summer = trial_.env("summer", {"--dataset", "plain", "--data", trial_.folder() / "route"});
  const auto encoder = trial_.encoder({"--reference", "summer"});
  const auto training = trial_.train(40, "out", {"--place_filter-slip", "0.2", "--place_filter-kidnap", "0.02"});
  ASSERT_EQ(training->wait(kLongWait), 0) << training->output() << encoder->output();
  auto driven = robot("fall", nodes() + Arguments{"--city", "2"});
  const auto env = live("fall", "", {"--goal", "/goal_pose", "--status", "/status", "--max-lost", "0.3"});
  Operator person(GetParam(), ros_domain_, trial_.folder() / "route/summer.poses.csv");
  const auto policy =
      trial_.policy({"--mode", "evaluate", "--checkpoint", trial_.folder() / "out/checkpoints/best.clk", "--evaluate",
                     "live-fall", "--tasks", "1", "--max-steps", "500", "--output", trial_.folder() / "repeat"});
  ASSERT_TRUE(person.sends_until(18, "lost 18")) << person.heard() << env->output() << policy->output();
  // It is unsure, or, where two places of the route look alike to it, jumps from one to the other.
  EXPECT_TRUE(env->says("lost and stands: ", seconds(10))) << env->output();
  driven->end(SIGTERM, seconds(5));
  driven = robot("fall", nodes());
  EXPECT_TRUE(person.hears("arrived 18")) << person.heard() << env->output();
  EXPECT_TRUE(env->says("robot: the problem is solved", seconds(10))) << env->output();
  EXPECT_EQ(policy->wait(kLongWait), 0) << policy->output();
}

TEST_P(TeachAndRepeat, WrongOptionsAreOneClearLine) {
  std::filesystem::create_directories(trial_.folder() / "route/summer");
  for (const char* name : {"0.png", "1.png"}) write_grey(trial_.folder() / ("route/summer/" + std::string(name)), 90);
  std::ofstream(trial_.folder() / "route/summer.poses.csv") << "x,y\n0,0\n2,0\n";
  const std::vector<std::pair<Arguments, std::string>> cases = {
      {{"--camera", ""}, "--camera: the camera's topic is missing"},
      {{"--position", ""}, "--position: the topic that says where the robot is is missing"},
      {{"--position-type", "fix"}, "its places have no lat and lon"},
      {{"--agents", "2"}, "--agents: a robot is one agent"},
      {{"--slip", "0.1"}, "a robot is imperfect by itself"},
      {{"--dataset", "plain"}, "--camera: is of a robot (add --dataset live, or leave it out)"},
      {{"--goal", "/goal pose"}, "--goal: '/goal pose' is not a topic of ROS 2"},
      {{"--camera", "camera//x"}, "'camera//x' is not a topic of ROS 2"}};
  for (const auto& [wrong, text] : cases) {
    const auto refused = trial_.env("summer", taught("/compressed", "/pose") + wrong + nodes());
    EXPECT_EQ(refused->wait(seconds(10)), 1) << refused->output();
    EXPECT_TRUE(contains(refused->output(), text)) << refused->output();
    EXPECT_EQ(occurrences("\n" + refused->output(), "\nenv_service: "), 1) << refused->output();
  }
}

}  // namespace
}  // namespace citylearn::testing
