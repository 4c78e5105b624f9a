// SPDX-License-Identifier: Apache-2.0
// A simulated robot is driven along the drawn city and taught from, over the in-process middleware.
#include "tools/robot/teacher.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>
#include <optional>

#include "core/ros2/header.h"
#include "tests/support/files.h"
#include "tests/support/processes/domain.h"
#include "tests/support/ros2_client.h"
#include "tests/support/ros2_time.h"
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
    now_ = std::max(now_, robot.due());  // it was made later than the test
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
  drive(robot, 5, [&] { teacher.poll(now_); });
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

TEST_F(Teaching, TimeMayBeThatOfASimulator) {
  Ros2Options simulated = ros_;
  simulated.use_sim_time = true;
  Ros2Participant player(ros_, "player", nullptr), world(simulated, "world", nullptr),
      ears(simulated, "teach", nullptr);
  Teacher teacher(teach_, ears);
  robot_.drive = 5;
  SimulatedRobot robot(robot_, world);
  const Clock::time_point much_later = now_ + std::chrono::hours(1);
  const auto advance = [&] {
    world.poll();
    robot.advance(now_);
    ears.poll();
    teacher.poll(now_);
  };
  advance();
  EXPECT_EQ(robot.pictures(), 0u) << "no time is known";
  for (int time = 0; time <= 4'100; time += 5) {
    player.publish("/clock", ros2_clock(100 + 1e-3 * time));
    advance();
    if (time == 2'000) now_ = much_later;  // it is paused
  }
  EXPECT_TRUE(robot.at_end()) << "20 m at 5 m/s";
  EXPECT_GE(teacher.frames(), 9) << "2 m apart";
  EXPECT_EQ(teacher.shortcomings(), std::vector<std::string>());
  EXPECT_EQ(teacher.trouble(much_later + std::chrono::hours(1)), "");
  EXPECT_TRUE(contents(folder_ / "route/summer.poses.csv").starts_with("file,x,y,time\n000000.png,0.000000000,"));
  EXPECT_TRUE(contains(contents(folder_ / "route/summer.poses.csv"), ",100.")) << "the simulator's seconds";
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

TEST_F(Teaching, NodesPauseIt) {
  using Request = std_srvs::srv::dds_::SetBool_Request_;
  Ros2Participant world(ros_, "world", nullptr), ears(ros_, "teach", nullptr);
  teach_.paused = true;
  Teacher teacher(teach_, ears);
  Ros2Client<Request, std_srvs::srv::dds_::SetBool_Response_> record(ros_, "/citylearn/teach/record");
  const auto answer = [&] {
    teacher.poll(now_);
    const auto reply = record.reply();
    return reply ? (reply->success() ? "yes: " : "no: ") + reply->message() : "nothing";
  };
  const auto call = [&](bool data) {
    Request request;
    request.data(data);
    record.call(request);
    return answer();
  };
  robot_.drive = 5;
  SimulatedRobot robot(robot_, world);
  drive(robot, 1, [&] { teacher.poll(now_); });
  EXPECT_EQ(teacher.frames(), 0);
  EXPECT_EQ(call(true), "yes: 0 frames");
  drive(robot, 0.5, [&] { teacher.poll(now_); });
  EXPECT_GE(teacher.frames(), 1);
  const std::string frames = std::to_string(teacher.frames()) + " frames";
  EXPECT_EQ(call(false), "yes: " + frames + ", paused");
  EXPECT_EQ(call(false), "yes: " + frames + ", paused");
  drive(robot, 2, [&] { teacher.poll(now_); });
  EXPECT_EQ(call(true), "yes: " + frames);
  drive(robot, 0.1, [&] { teacher.poll(now_); });
  EXPECT_TRUE(teacher.shortcomings().at(0).starts_with("recording was paused: 1")) << teacher.shortcomings().at(0);
  // Encapsulation and content: nothing, not a boolean, more than one.
  for (const auto& content : std::vector<std::vector<int>>{{}, {7}, {1, 0, 0, 0, 0}}) {
    Bytes bytes = {std::byte{0}, std::byte{1}, std::byte{0}, std::byte{0}};
    for (const int byte : content) bytes.push_back(std::byte(byte));
    record.send(bytes);
    EXPECT_EQ(answer(), "no: the request cannot be read") << bytes.size();
  }
  drive(robot, 0.5, [&] { teacher.poll(now_); });
  EXPECT_EQ(call(false), "yes: " + std::to_string(teacher.frames()) + " frames, paused") << "it goes on";
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

/// Sends pictures and fixes ten times a second by a clock of the test's own, from a robot that drives north at 2.1 m/s.
class TeachingByFix : public Teaching {
 protected:
  using Fix = sensor_msgs::msg::dds_::NavSatFix_;
  using Image = sensor_msgs::msg::dds_::Image_;

  TeachingByFix() {
    teach_.topics = {"/camera/image", "/fix", PositionSource::kFix};
    teacher_.emplace(teach_, ears_);
  }
  /// Calls `change` with the tenth of a second and both messages, which may then be sent or not.
  struct Sent {
    Image image;
    Fix fix;
    bool picture = true, position = true;
  };
  void drive(int tenths, const std::function<void(int, Sent&)>& change) {
    for (int tenth = 0; tenth < tenths; ++tenth) {
      Sent sent;
      sent.fix.header(ros2_header("gps", 1'000'000'000'000 + tenth * 100'000'000ull));
      sent.fix.latitude(48 + 0.21 * tenth / kDegree);
      sent.fix.longitude(11);
      sent.image.header(sent.fix.header());
      sent.image.width(2);
      sent.image.height(1);
      sent.image.step(2);
      sent.image.encoding("mono8");
      sent.image.data({1, 2});
      change(tenth, sent);
      if (sent.position) world_.publish("/fix", sent.fix);
      if (sent.picture) world_.publish("/camera/image", sent.image);
      teacher_->poll(now_ + tenth * std::chrono::milliseconds(100));
    }
  }
  static void lose(Fix& fix) {
    fix.status().status(0xFF);  // -1, STATUS_NO_FIX
    fix.latitude(std::nan(""));
  }

  static constexpr double kDegree = 6'371'008.8 * std::numbers::pi / 180;  // metres
  Ros2Participant world_{ros_, "world", nullptr}, ears_{ros_, "teach", nullptr};
  std::optional<Teacher> teacher_;
};
using Lines = std::vector<std::string>;

TEST_F(TeachingByFix, AHoleOfPositionsIsToldWithItsMetres) {
  // Frames at 0 to 4 s, at 0 to 8.4 m; then no fix until 8 s, at 16.8 m.
  drive(110, [](int tenth, Sent& sent) {
    if (tenth > 40 && tenth < 80) lose(sent.fix);
  });
  EXPECT_EQ(teacher_->frames(), 8) << "three more, at 8, 9 and 10 s";
  EXPECT_EQ(teacher_->shortcomings(),
            (Lines{"/fix has no fix (39 messages)", "4 s without a position: 8.4 m without frames before 000005.png"}));
}

TEST_F(TeachingByFix, TheLongestOfSeveralHolesAndWhoIsSilent) {
  drive(200, [](int tenth, Sent& sent) {
    sent.position = tenth <= 40 || tenth >= 70;
    sent.picture = tenth <= 100 || tenth >= 160;
  });
  EXPECT_EQ(teacher_->shortcomings(),
            (Lines{"6 s without a picture: 12.6 m without frames before 000009.png, the longest of 2 holes"}));
}

TEST_F(TeachingByFix, ALeapOfThePositionIsAHole) {
  drive(40, [](int tenth, Sent& sent) {
    if (tenth >= 20) sent.fix.latitude(sent.fix.latitude() + 50 / kDegree);
  });
  EXPECT_EQ(teacher_->shortcomings(), Lines{"the position leapt: 52.1 m without frames before 000002.png"});
}

TEST_F(TeachingByFix, PositionsThatBeginLateOrEndEarlyAreTold) {
  drive(120, [](int tenth, Sent& sent) { sent.position = tenth >= 40 && tenth <= 80; });
  EXPECT_EQ(teacher_->frames(), 5) << "at 4 to 8 s";
  EXPECT_EQ(teacher_->shortcomings(), (Lines{"4 s without a position: no frames before 000000.png",
                                             "4 s without a position: no frames after 000004.png"}));
}

TEST_F(TeachingByFix, APictureIsNotUsedWithAPositionOfAnotherTime) {
  // The camera falls silent at 4.5 s, 1 m behind the last frame, and comes back at 7.5 s, at 15.75 m.
  drive(100, [](int tenth, Sent& sent) { sent.picture = tenth <= 45 || tenth >= 75; });
  EXPECT_EQ(teacher_->frames(), 5 + 3) << "none with the picture of 4.5 s";
  EXPECT_TRUE(contains(contents(folder_ / "route/summer.poses.csv"), "000005.png,48.000141643,"));
}

TEST_F(TeachingByFix, SlowTopicsAreUsedTogether) {
  // A picture each 2 s, and a position 1.5 s after it: that is each 4.2 m, once it is known how often they come.
  drive(100, [](int tenth, Sent& sent) {
    sent.picture = tenth % 20 == 0;
    sent.position = tenth % 20 == 15;
  });
  EXPECT_EQ(teacher_->frames(), 4);
  EXPECT_EQ(teacher_->shortcomings(),
            Lines{"2 s without a picture: 4.2 m without frames before 000001.png, the longest of 3 holes"});
}

TEST_F(TeachingByFix, WithoutAnyFixThatIsTheReason) {
  drive(110, [](int, Sent& sent) { lose(sent.fix); });
  EXPECT_EQ(teacher_->trouble(now_ + std::chrono::seconds(9)), "/fix has no fix (110 messages)");
  EXPECT_EQ(teacher_->why_no_route(), "/fix has no fix (110 messages)");
  EXPECT_EQ(teacher_->shortcomings(), Lines{"/fix has no fix (110 messages)"});
}

TEST_F(TeachingByFix, WhenAllPicturesWereRefusedThatIsTheReason) {
  drive(59, [](int, Sent& sent) { sent.image.encoding("32FC1"); });
  EXPECT_TRUE(teacher_->why_no_route().starts_with(
      "59 of 59 pictures were refused: /camera/image has encoding '32FC1'; known: 8UC1, "))
      << teacher_->why_no_route();
  EXPECT_TRUE(teacher_->why_no_route().ends_with(" (59 messages)")) << teacher_->why_no_route();
}

TEST_F(TeachingByFix, ARobotThatStandsIsToldToDrive) {
  drive(20, [](int, Sent& sent) { sent.fix.latitude(48); });
  EXPECT_EQ(teacher_->why_no_route(), "let the robot drive while this records");
  EXPECT_EQ(teacher_->shortcomings(), Lines());
}

TEST_F(TeachingByFix, WithoutPositionsSecondsCount) {
  teach_.topics.position = "";
  teacher_.emplace(teach_, ears_);
  drive(120, [](int tenth, Sent& sent) {
    sent.picture = tenth <= 30 || tenth >= 60;
    if (tenth >= 80) sent.image.header(ros2_header("camera", tenth * 100'000'000ull));  // the clock is set back
  });
  EXPECT_EQ(teacher_->frames(), 4 + 2 + 4) << "of 0 to 3 s, 6 and 7 s, then 8 to 11 s by another clock";
  EXPECT_EQ(teacher_->shortcomings(),
            (Lines{"/camera/image is older than the one before: a clock was set back, or two cameras send (1 message)",
                   "3 s without a picture: no frames before 000004.png"}));
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
