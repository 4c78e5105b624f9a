// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "core/ros2/participant.h"
#include "core/util/random.h"
#include "env_service/drawn_city/drawn_images.h"
#include "ros2/ros2.h"

namespace citylearn {

struct SimulatedRobotOptions {
  // The city.
  std::string look = "summer";  ///< season, weather and light: drawn_names()
  DrawnOptions drawn;
  double metres = 512;  ///< length of the route

  // The robot.
  double rate = 20;           ///< pictures and positions a second
  double speed_limit = 50;    ///< m/s
  double slip = 0;            ///< standard deviation of the way really driven, as a share of that of the wheels
  double position_noise = 0;  ///< metres, standard deviation of each coordinate of pose
  double drive = 0;           ///< m/s: it drives to the end by itself, as when it is taught; 0: by commands
  std::uint64_t seed = 1;     ///< of slip, noise and faults

  // What goes wrong with its pictures: shares of them.
  double lost = 0, repeated = 0, late = 0;

  // Topics of ROS 2.
  std::string camera = "/camera/image_raw/compressed";  ///< sensor_msgs/CompressedImage
  std::string odometry = "/odom";                       ///< nav_msgs/Odometry, by its wheels: it drifts
  std::string pose = "/pose";                           ///< geometry_msgs/PoseStamped, as something outside measures it
  std::string cmd_vel = "/cmd_vel";                     ///< geometry_msgs/Twist: linear.x along the route
};

/// A robot that follows the road of the drawn city, as fast and in the direction that commands say; it stops half a
/// second after the last one. Used by one thread.
class SimulatedRobot {
 public:
  /// `ros` must outlive it. Throws Error for an unknown look or a name that is not a topic.
  SimulatedRobot(const SimulatedRobotOptions& options, Ros2Participant& ros);

  /// Drives up to what its clock says at that time of the steady clock, and publishes what is due.
  void advance(Clock::time_point steady);
  /// Returns when advance() is to be called again.
  Clock::time_point due() const { return due_; }
  double metres() const { return metres_; }  ///< along the route
  /// Returns whether it has driven to the end by itself.
  bool at_end() const { return options_.drive > 0 && metres_ >= options_.metres; }
  std::uint64_t pictures() const { return pictures_; }  ///< published

 private:
  struct Point {
    double x = 0, y = 0;
  };
  Point point_at(double metres) const;
  void take_commands(Clock::time_point now);
  void publish_picture();
  void publish_position();

  const SimulatedRobotOptions options_;
  Ros2Participant& ros_;
  Ros2Subscription<geometry_msgs::msg::dds_::Twist_> commands_;
  DrawnDrive drive_;
  std::vector<Point> road_;  // every half metre
  Random slips_, noise_, faults_;

  double metres_ = 0, wheels_ = 0;                    // along the route, really and by its wheels
  double speed_ = 0, grip_ = 1;                       // commanded, m/s; of this drive
  Clock::time_point driven_, stop_at_, next_report_;  // by its clock
  Clock::time_point due_;
  sensor_msgs::msg::dds_::CompressedImage_ picture_, kept_;  // kept_: one that comes late
  bool has_kept_ = false;
  std::uint64_t pictures_ = 0;
  Bytes file_;
};

}  // namespace citylearn
