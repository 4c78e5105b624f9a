// SPDX-License-Identifier: Apache-2.0
// A simulated robot is driven along the drawn city and taught from, over the in-process middleware.
#include "tools/robot/teacher.h"

#include <gtest/gtest.h>

#include "tests/support/files.h"
#include "tests/support/processes/domain.h"
#include "tests/support/text.h"
#include "tools/robot/simulated_robot.h"

namespace citylearn::testing {
namespace {

class Teaching : public ::testing::Test {
 protected:
  Teaching() {
    ros_.name = "inprocess";
    ros_.domain = own_domain();
    teach_.topics = {"/camera/image_raw/compressed", "/pose", PositionSource::kPose};
    teach_.folder = folder_ / "route";
    teach_.traversal = "summer";
    robot_.metres = 20;
    robot_.drawn.width = 32;
    robot_.drawn.height = 32;
  }
  /// Drives the robot by a clock of the test's own.
  void drive(
      SimulatedRobot& robot, double seconds, const std::function<void()>& each = [] {}) {
    for (const Clock::time_point end =
             now_ + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
         now_ < end; now_ += std::chrono::milliseconds(5)) {
      robot.advance(now_);
      each();
    }
  }

  Folder folder_;
  MiddlewareOptions ros_;
  TeachOptions teach_;
  SimulatedRobotOptions robot_;
  Clock::time_point now_ = Clock::now();
};

TEST_F(Teaching, AFrameEveryFewMetresWithItsPlace) {
  Ros2Participant world(ros_, "world", nullptr), ears(ros_, "teach", nullptr);
  Teacher teacher(teach_, ears);
  robot_.drive = 5;
  robot_.lost = robot_.repeated = robot_.late = 0.1;
  SimulatedRobot robot(robot_, world);
  drive(robot, 5, [&] { teacher.poll(); });
  EXPECT_TRUE(robot.at_end());
  EXPECT_GE(teacher.frames(), 8) << "20 m, 2 m apart";
  EXPECT_LE(teacher.frames(), 11);
  std::size_t pictures = 0;
  for ([[maybe_unused]] const auto& file : std::filesystem::directory_iterator(folder_ / "route/summer")) ++pictures;
  EXPECT_EQ(pictures, static_cast<std::size_t>(teacher.frames()));
  const std::string poses = contents(folder_ / "route/summer.poses.csv");
  EXPECT_TRUE(poses.starts_with("file,x,y,time\n000000.png,0.0")) << poses;
  EXPECT_EQ(occurrences(poses, "\n"), teacher.frames() + 1);
  EXPECT_THROW(Teacher(teach_, ears), Error) << "a traversal is never overwritten";
}

TEST_F(Teaching, NothingIsLeftOfARouteWithoutFrames) {
  Ros2Participant ears(ros_, "teach", nullptr);
  {
    Teacher teacher(teach_, ears);
    teacher.poll();
    EXPECT_TRUE(std::filesystem::exists(folder_ / "route/summer")) << "it can be written";
  }
  EXPECT_FALSE(std::filesystem::exists(folder_ / "route/summer"));
}

TEST_F(Teaching, ATopicThatFallsSilentIsNamed) {
  Ros2Participant world(ros_, "world", nullptr), ears(ros_, "teach", nullptr);
  Teacher teacher(teach_, ears);
  const auto later = [] { return Clock::now() + std::chrono::seconds(4); };
  EXPECT_EQ(teacher.trouble(Clock::now()), "");
  EXPECT_EQ(teacher.trouble(later()),
            "nobody publishes sensor_msgs/msg/CompressedImage on /camera/image_raw/compressed");
  robot_.drive = 5;
  SimulatedRobot robot(robot_, world);
  drive(robot, 1, [&] { teacher.poll(); });
  EXPECT_GT(teacher.frames(), 0);
  EXPECT_EQ(teacher.trouble(Clock::now()), "");
  EXPECT_EQ(teacher.trouble(later()), "nothing comes on /camera/image_raw/compressed");
}

TEST_F(Teaching, RobotsObeyCommandsAndStopWithoutThem) {
  Ros2Participant world(ros_, "world", nullptr), ears(ros_, "driver", nullptr);
  geometry_msgs::msg::dds_::Twist_ twist;
  twist.linear().x(10);
  for (const double slip : {0.0, 0.3}) {
    robot_.slip = slip;
    SimulatedRobot robot(robot_, world);
    ears.publish("/cmd_vel", twist);
    drive(robot, 3);
    const double error = std::abs(robot.metres() - 5);
    EXPECT_EQ(error > 0.2, slip > 0) << "it drives half a second, then its watchdog stops it: " << error;
  }
}

}  // namespace
}  // namespace citylearn::testing
