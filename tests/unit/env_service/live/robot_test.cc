// SPDX-License-Identifier: Apache-2.0
// A robot as its topics show it, over the in-process middleware.
#include "env_service/live/robot.h"

#include <gtest/gtest.h>

#include "core/task/action.h"
#include "core/util/wall_clock.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Picture = sensor_msgs::msg::dds_::CompressedImage_;
using Pose = geometry_msgs::msg::dds_::PoseStamped_;
using Twist = geometry_msgs::msg::dds_::Twist_;

constexpr int kPlaces = 10;
constexpr double kMetres = 2;  // between places

MiddlewareOptions in_process() {
  MiddlewareOptions options;
  options.name = "inprocess";
  options.domain = own_domain();
  return options;
}

template <class Header>
void stamp(Header& header, double seconds) {
  header.stamp().sec(static_cast<std::int32_t>(seconds));
  header.stamp().nanosec(static_cast<std::uint32_t>(1e9 * (seconds - static_cast<std::int32_t>(seconds))));
}

Traversal taught() {
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

std::string grey_file() {
  const Folder folder;
  write_grey(folder / "grey.png", 100);
  return contents(folder / "grey.png");
}

class RobotTest : public ::testing::Test {
 protected:
  RobotOptions options() const {
    RobotOptions robot;
    robot.ros = ros_;
    robot.topics = {"/camera/compressed", "/pose", PositionSource::kPose};
    robot.speed = 100;
    robot.settle = 0.5;
    return robot;
  }
  Robot make(const RobotOptions& robot) { return Robot(robot, "robot", own_, taught_, images_); }

  void send_picture(double seconds, const std::string& file) {
    Picture picture;
    stamp(picture.header(), seconds);
    picture.data().assign(file.begin(), file.end());
    world_.publish("/camera/compressed", picture);
  }
  void send_pose(double seconds, double x) {
    Pose pose;
    stamp(pose.header(), seconds);
    pose.pose().position().x(x);
    pose.pose().position().y(5);
    world_.publish("/pose", pose);
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

  MiddlewareOptions ros_ = in_process(), own_ = in_process();
  Traversal taught_ = taught();
  LiveImages images_{std::make_shared<FakeImages>(kPlaces), "robot", 1};
  Ros2Participant world_{ros_, "world", nullptr};
  Ros2Subscription<Twist> twists_ = world_.subscribe<Twist>("/cmd_vel");
  const std::string file_ = grey_file();
};

TEST_F(RobotTest, LooksWhereItStands) {
  Robot robot = make(options());
  robot.look();
  send_picture(10, file_);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "it is not known where";
  send_pose(10, 6.4);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->place, 3);
  EXPECT_EQ(seen->frame, kPlaces) << "behind the pictures taught";
  Bytes bytes;
  images_.read(seen->frame, bytes);
  EXPECT_EQ(bytes.size(), file_.size());
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "once";
}

TEST_F(RobotTest, DrivesStopsAndLooksAgain) {
  Robot robot = make(options());
  robot.look();
  send_picture(10, file_);
  send_pose(10, 6);
  ASSERT_TRUE(seen_by(robot));
  commands();
  auto steps = world_.subscribe<std_msgs::msg::dds_::UInt8_>("/citylearn/command");
  robot.drive(kPrevious, 3, 2);
  send_picture(10.1, file_);  // on the way
  send_pose(10.1, 5);
  EXPECT_FALSE(seen_by(robot, milliseconds(100))) << "what was taken on the way does not count";
  const std::vector<double> speeds = commands();
  ASSERT_GE(speeds.size(), 2u);
  EXPECT_EQ(speeds.front(), -100);
  EXPECT_EQ(speeds.back(), 0);
  std_msgs::msg::dds_::UInt8_ step;
  ASSERT_TRUE(steps.take(step));
  EXPECT_EQ(step.data(), kPrevious);
  EXPECT_FALSE(steps.take(step)) << "once: a robot that does its steps itself would do two";
  send_picture(10.55, file_);
  send_pose(10.55, 4);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "less than 0.5 s after the last one that may show the way";
  send_picture(10.7, file_);
  send_pose(10.7, 4);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->place, 2);
  EXPECT_EQ(seen->frame, kPlaces + 1);
}

TEST_F(RobotTest, PicturesThatComeTwiceLateOrBrokenAreCounted) {
  Robot robot = make(options());
  robot.look();
  send_pose(10, 6);
  send_picture(10, "no picture");
  EXPECT_FALSE(seen_by(robot, milliseconds(20)));
  send_picture(10.5, file_);
  send_picture(10.5, file_);
  send_picture(10.2, file_);
  ASSERT_TRUE(seen_by(robot));
  seen_by(robot, milliseconds(20));
  EXPECT_EQ(robot.counts().broken, 1u);
  EXPECT_EQ(robot.counts().pictures, 1u);
  EXPECT_EQ(robot.counts().repeated, 1u);
  EXPECT_EQ(robot.counts().late, 1u);
  robot.look();
  send_pose(11, 6);
  send_picture(2, file_);
  EXPECT_TRUE(seen_by(robot)) << "a robot that has started again, without the time";
}

TEST_F(RobotTest, SaysWhatItWaitsFor) {
  Robot robot = make(options());
  robot.look();
  const auto later = [] { return Clock::now() + seconds(4); };
  EXPECT_EQ(robot.trouble(Clock::now()), "");
  EXPECT_EQ(robot.trouble(later()), "nobody publishes sensor_msgs/msg/CompressedImage on /camera/compressed");
  send_picture(10, "no picture");
  seen_by(robot, milliseconds(20));
  EXPECT_TRUE(contains(robot.trouble(later()), "pictures on /camera/compressed are broken")) << robot.trouble(later());
  send_picture(11, file_);
  seen_by(robot, milliseconds(20));
  EXPECT_EQ(robot.trouble(later()), "nobody publishes geometry_msgs/msg/PoseStamped on /pose");
  send_pose(11, 0);
  ASSERT_TRUE(seen_by(robot));
  EXPECT_EQ(robot.trouble(later()), "");
}

TEST_F(RobotTest, WrongOptionsAreOneClearError) {
  const auto expect = [&](const RobotOptions& wrong, const std::string& text) {
    try {
      make(wrong);
      ADD_FAILURE() << text;
    } catch (const Error& error) {
      EXPECT_TRUE(contains(error.what(), text)) << error.what();
    }
  };
  RobotOptions wrong = options();
  wrong.topics.camera = "";
  expect(wrong, "--camera: the camera's topic is missing");
  wrong.topics.camera = "camera//image";
  expect(wrong, "--camera: 'camera//image' is not a topic");
  wrong = options();
  wrong.topics.position = "";
  expect(wrong, "--position: the topic that says where the robot is is missing");
  wrong = options();
  wrong.topics.source = PositionSource::kFix;
  expect(wrong, "its places have no lat and lon");
  taught_.x.clear();
  expect(options(), "its places have no x and y");
}

}  // namespace
}  // namespace citylearn::testing
