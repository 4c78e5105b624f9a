// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "core/ros2/participant.h"
#include "core/task/lost.h"

namespace CLI {
class App;
}

namespace citylearn {

/// The kind of topic that gives a robot's position.
enum class PositionSource {
  kOdometry,            ///< nav_msgs/Odometry: x and y, metres
  kPose,                ///< geometry_msgs/PoseStamped: likewise
  kPoseWithCovariance,  ///< geometry_msgs/PoseWithCovarianceStamped: likewise
  kFix,                 ///< sensor_msgs/NavSatFix: degrees (WGS 84)
};

/// The topics of ROS 2 on which a robot publishes its pictures and positions.
struct RobotTopics {
  std::string camera;    ///< --camera: sensor_msgs/CompressedImage where the name ends in /compressed, else Image
  std::string position;  ///< --position; empty: nothing says where it is
  PositionSource source = PositionSource::kOdometry;  ///< --position-type
};

/// Options for driving a robot along a route that it was taught.
struct RobotOptions {
  Ros2Options ros = ros2_defaults();
  RobotTopics topics;
  std::string goal;                            ///< --goal: where it is sent; empty: the task draws goals
  std::string status = "/citylearn/status";    ///< --status: std_msgs/String goes there, when it is sent to goals
  std::string cmd_vel = "/cmd_vel";            ///< --cmd-vel: geometry_msgs/Twist goes there
  std::string command = "/citylearn/command";  ///< --command: std_msgs/UInt8, once a step: 0 stay, 1 next, 2 previous
  double speed = 0.5;                          ///< --speed, m/s: a step drives for as long as its distance takes
  double settle = 0.1;  ///< --settle, seconds: what the camera took this long after the robot stopped is sharp
  double off_route =
      0;  ///< --off-route, metres from the nearest place: farther away it stands; 0: ten places' distance
  double max_lost = kMaxLost;  ///< --max-lost, the `bound` of LostWatch: when it says so it stands; 1: it never does
};

/// Adds the options of RobotTopics and those of ROS 2's side.
void add_robot_topics(CLI::App& app, RobotTopics& topics, Ros2Options& ros);
/// Adds all of RobotOptions; `group` heads them in --help.
void add_robot_options(CLI::App& app, RobotOptions& robot, const std::string& group);

}  // namespace citylearn
