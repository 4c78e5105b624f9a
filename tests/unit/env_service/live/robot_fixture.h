// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <limits>

#include "env_service/live/robot.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/options.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/ros2_client.h"
#include "tests/support/ros2_time.h"
#include "tests/support/text.h"

namespace citylearn::testing {

/// A robot as its topics show it, over the in-process middleware.
class RobotTest : public ::testing::Test {
 protected:
  using Picture = sensor_msgs::msg::dds_::CompressedImage_;
  using Fix = sensor_msgs::msg::dds_::NavSatFix_;
  using Pose = geometry_msgs::msg::dds_::PoseStamped_;
  using Twist = geometry_msgs::msg::dds_::Twist_;
  static constexpr int kPlaces = 10;
  static constexpr double kMetres = 2;  ///< between places
  static constexpr double kNan = std::numeric_limits<double>::quiet_NaN(),
                          kInfinite = std::numeric_limits<double>::infinity();

  template <class Header>
  static void stamp(Header& header, double at) {
    header.stamp(ros2_clock(at).clock());
  }

  static Traversal taught() {
    Traversal traversal = small_traversal(kPlaces);
    traversal.features.clear();
    traversal.dimension = 0;
    for (int i = 0; i < kPlaces; ++i) {
      traversal.positions[static_cast<std::size_t>(i)] = static_cast<float>(kMetres * i);
      traversal.x.push_back(kMetres * i);
      traversal.y.push_back(5);
    }
    return traversal;
  }

  static std::string grey_file() {
    const Folder folder;
    write_grey(folder / "grey.png", 100);
    return contents(folder / "grey.png");
  }
  RobotOptions options() const {
    RobotOptions robot;
    robot.ros = ros_;
    robot.topics = {"/camera/compressed", "/pose", PositionSource::kPose};
    robot.speed = 100;
    robot.settle = 0.5;
    return robot;
  }
  /// A robot whose places are 1.57 m apart on the 45th parallel, and which hears fixes and goals.
  RobotOptions with_fixes() {
    taught_.latitude.assign(kPlaces, 45);
    for (int i = 0; i < kPlaces; ++i) taught_.longitude.push_back(11 + 2e-5 * i);
    RobotOptions robot = options();
    robot.topics.position = "/fix";
    robot.topics.source = PositionSource::kFix;
    robot.goal = "/goal_fix";
    return robot;
  }
  Robot make(const RobotOptions& robot) { return Robot(robot, "robot", own_, taught_, images_); }

  void send_picture(double at, const std::string& file) {
    Picture picture;
    stamp(picture.header(), at);
    picture.data().assign(file.begin(), file.end());
    world_.publish("/camera/compressed", picture);
  }
  void send_pose(double at, double x) {
    Pose pose;
    stamp(pose.header(), at);
    pose.pose().position().x(x);
    pose.pose().position().y(5);
    world_.publish("/pose", pose);
  }
  void send(double at, double x) {
    send_picture(at, file_);
    send_pose(at, x);
  }
  void send_fix(const std::string& topic, double at, int status, double latitude, double longitude) {
    Fix fix;
    stamp(fix.header(), at);
    fix.status().status(static_cast<std::uint8_t>(status));
    fix.latitude(latitude);
    fix.longitude(longitude);
    world_.publish(topic, fix);
  }
  void send_time(double at) { world_.publish("/clock", ros2_clock(at)); }
  void send_goal(double x, const std::string& frame = "map") {
    Pose goal;
    goal.header().frame_id(frame);
    goal.pose().position().x(x);
    goal.pose().position().y(5);
    world_.publish("/goal", goal);
  }
  /// Returns what was said on the status topic since the last call.
  std::vector<std::string> said() {
    std::vector<std::string> all;
    for (std_msgs::msg::dds_::String_ status; status_.take(status);) all.push_back(status.data());
    return all;
  }
  /// Returns where the robot was sent since the last call.
  static std::vector<int> goals_of(Robot& robot) {
    std::vector<int> places;
    robot.take_goals([&](int place) {
      places.push_back(place);
      return "";
    });
    return places;
  }
  /// Polls until the robot has seen something, or half a second is over.
  static std::optional<Sighting> seen_by(Robot& robot, milliseconds patience = milliseconds(500)) {
    std::optional<Sighting> seen;
    poll_until([&] { return (seen = robot.poll(Clock::now())).has_value(); }, patience);
    return seen;
  }
  std::vector<double> commands() {
    std::vector<double> speeds;
    for (Twist twist; twists_.take(twist);) speeds.push_back(twist.linear().x());
    return speeds;
  }

  MiddlewareOptions ros_ = middleware_options("inprocess", own_domain()),
                    own_ = middleware_options("inprocess", own_domain());
  Traversal taught_ = taught();
  LiveImages images_{std::make_shared<FakeImages>(kPlaces), "robot", 1};
  Ros2Participant world_{ros_, "world", nullptr};
  Ros2Subscription<std_msgs::msg::dds_::String_> status_ =
      world_.subscribe<std_msgs::msg::dds_::String_>("/citylearn/status", Profile::kRos2Reliable);
  Ros2Subscription<Twist> twists_ = world_.subscribe<Twist>("/cmd_vel");
  const std::string file_ = grey_file();
};

}  // namespace citylearn::testing
