// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/robot_options.h"

#include <CLI/CLI.hpp>
#include <map>

#include "core/wire/service.h"

namespace citylearn {
namespace {

const std::map<std::string, PositionSource> kSources = {{"odometry", PositionSource::kOdometry},
                                                        {"pose", PositionSource::kPose},
                                                        {"pose_with_covariance", PositionSource::kPoseWithCovariance},
                                                        {"fix", PositionSource::kFix}};

}  // namespace

void add_robot_topics(CLI::App& app, RobotTopics& topics, Ros2Options& ros) {
  app.add_option("--camera", topics.camera,
                 "Topic of the robot's camera: sensor_msgs/CompressedImage where it ends in /compressed, else Image")
      ->type_name("TOPIC");
  app.add_option("--position", topics.position, "Topic that says where the robot is")->type_name("TOPIC");
  app.add_option_function<std::string>(
         "--position-type", [&topics](const std::string& name) { topics.source = kSources.at(name); },
         "Its type: odometry (nav_msgs/Odometry), pose (geometry_msgs/PoseStamped), pose_with_covariance "
         "(PoseWithCovarianceStamped, as of amcl) or fix (sensor_msgs/NavSatFix)")
      ->default_str("odometry")
      ->check(CLI::IsMember({"odometry", "pose", "pose_with_covariance", "fix"}));
  add_ros2_options(app, ros);
}

void add_robot_options(CLI::App& app, RobotOptions& robot, const std::string& group) {
  const OptionGroup options(app, group);
  add_robot_topics(app, robot.topics, robot.ros);
  app.add_option("--goal", robot.goal,
                 "Topic of goals, geometry_msgs/PoseStamped (--position-type fix: sensor_msgs/NavSatFix): an episode "
                 "begins when one comes; without it goals are drawn")
      ->type_name("TOPIC");
  app.add_option("--status", robot.status,
                 "Topic that says, with --goal, what becomes of goals, std_msgs/String: stopped or waiting; driving, "
                 "lost, arrived, failed or replaced and the goal's place; refused")
      ->type_name("TOPIC")
      ->capture_default_str();
  app.add_option("--cmd-vel", robot.cmd_vel, "Topic to which speeds go, geometry_msgs/Twist")
      ->type_name("TOPIC")
      ->capture_default_str();
  app.add_option("--command", robot.command,
                 "Topic to which actions go, std_msgs/UInt8, once each: 0 stay, 1 next, 2 previous")
      ->type_name("TOPIC")
      ->capture_default_str();
  app.add_option("--speed", robot.speed, "Of the robot, m/s: a step drives for as long as its distance takes")
      ->capture_default_str()
      ->check(CLI::Range(0.01, 100.0));
  app.add_option("--settle", robot.settle,
                 "Seconds after a stop until the camera's pictures show where the robot stands")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 10.0));
  app.add_option("--off-route", robot.off_route,
                 "Metres from the nearest place beyond which the robot stands and goals are refused; 0: ten times the "
                 "distance between places")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1e6));
  app.add_option("--max-lost", robot.max_lost,
                 "Probability of being lost, as the agent believes, above which the robot stands and looks again; 1: "
                 "it never does")
      ->type_name("P")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1.0));
}

}  // namespace citylearn
