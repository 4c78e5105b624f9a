// SPDX-License-Identifier: Apache-2.0
#include "tools/robot/simulated_robot.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/ros2/header.h"

namespace citylearn {
namespace {

using Odometry = nav_msgs::msg::dds_::Odometry_;
using Pose = geometry_msgs::msg::dds_::PoseStamped_;
using Picture = sensor_msgs::msg::dds_::CompressedImage_;

constexpr double kRoadStep = 0.5;  // metres
constexpr std::chrono::milliseconds kWatchdog{500}, kStep{5};

SimulatedRobotOptions named(SimulatedRobotOptions options) {
  options.camera = ros2_topic(options.camera, "--camera");
  options.odometry = ros2_topic(options.odometry, "--odometry");
  options.pose = ros2_topic(options.pose, "--pose");
  options.cmd_vel = ros2_topic(options.cmd_vel, "--cmd-vel");
  return options;
}

}  // namespace

SimulatedRobot::SimulatedRobot(const SimulatedRobotOptions& options, Ros2Participant& ros)
    : options_(named(options)),
      ros_(ros),
      commands_(ros.subscribe<geometry_msgs::msg::dds_::Twist_>(options_.cmd_vel)),
      drive_(options_.drawn, options_.look),
      slips_{options_.seed, 1},
      noise_{options_.seed, 2},
      faults_{options_.seed, 3} {
  Point at;
  for (double metres = 0; metres <= options_.metres + 1; metres += kRoadStep) {
    road_.push_back(at);
    const double heading = drive_.heading(static_cast<float>(metres));
    at = {at.x + kRoadStep * std::cos(heading), at.y - kRoadStep * std::sin(heading)};  // to the right is -y
  }
  ros_.advertise<Picture>(options_.camera);
  ros_.advertise<Odometry>(options_.odometry);
  ros_.advertise<Pose>(options_.pose);
  due_ = Clock::now();
  driven_ = next_report_ = ros_.now();
}

SimulatedRobot::Point SimulatedRobot::point_at(double metres) const {
  const double steps = std::clamp(metres, 0.0, options_.metres) / kRoadStep;
  const auto index = std::min(static_cast<std::size_t>(steps), road_.size() - 2);
  const double part = steps - static_cast<double>(index);
  const Point &a = road_[index], &b = road_[index + 1];
  return {a.x + part * (b.x - a.x), a.y + part * (b.y - a.y)};
}

void SimulatedRobot::take_commands(Clock::time_point now) {
  for (geometry_msgs::msg::dds_::Twist_ twist; commands_.take(twist);) {
    const double speed = twist.linear().x();
    if (!std::isfinite(speed) || options_.drive > 0) continue;
    if (speed_ == 0 && speed != 0) grip_ = std::clamp(1 + options_.slip * slips_.normal(), 0.0, 2.0);
    speed_ = std::clamp(speed, -options_.speed_limit, options_.speed_limit);
    stop_at_ = now + kWatchdog;
  }
  if (options_.drive > 0)
    speed_ = metres_ < options_.metres ? options_.drive : 0;
  else if (now >= stop_at_)
    speed_ = 0;
}

void SimulatedRobot::advance(Clock::time_point steady) {
  due_ = steady + kStep;
  if (!ros_.clock().known()) return;
  const Clock::time_point now = ros_.clock().at(steady);
  const double way = speed_ * std::chrono::duration<double>(now - std::exchange(driven_, now)).count();
  wheels_ += way;
  metres_ = std::clamp(metres_ + grip_ * way, 0.0, options_.metres);
  take_commands(now);
  if (now >= next_report_) {
    next_report_ = std::max(next_report_, now - std::chrono::seconds(1)) +
                   std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(1 / options_.rate));
    publish_position();
    publish_picture();
  }
  if (!ros_.clock().simulated()) due_ = std::min(due_, next_report_);
}

void SimulatedRobot::publish_position() {
  const Point wheels = point_at(wheels_);
  Odometry odometry;
  odometry.header(ros2_header("odom", ros_.clock().time()));
  odometry.child_frame_id("base_link");
  odometry.pose().pose().position().x(wheels.x);
  odometry.pose().pose().position().y(wheels.y);
  odometry.pose().pose().orientation().w(1);
  odometry.twist().twist().linear().x(speed_);
  ros_.publish(options_.odometry, odometry);
  const Point here = point_at(metres_);
  Pose pose;
  pose.header(ros2_header("map", ros_.clock().time()));
  pose.pose().position().x(here.x + options_.position_noise * noise_.normal());
  pose.pose().position().y(here.y + options_.position_noise * noise_.normal());
  pose.pose().orientation().w(1);
  ros_.publish(options_.pose, pose);
}

void SimulatedRobot::publish_picture() {
  picture_.header(ros2_header("camera", ros_.clock().time()));
  picture_.format("png");
  drive_.draw(static_cast<float>(metres_), file_);
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(file_.data());
  picture_.data().assign(bytes, bytes + file_.size());
  const double fate = faults_.uniform();
  if (fate < options_.lost) return;
  if (fate < options_.lost + options_.late && !has_kept_) {
    kept_ = picture_;
    has_kept_ = true;
    return;
  }
  ros_.publish(options_.camera, picture_);
  ++pictures_;
  if (std::exchange(has_kept_, false)) ros_.publish(options_.camera, kept_);
  if (fate >= 1 - options_.repeated) ros_.publish(options_.camera, picture_);
}

}  // namespace citylearn
