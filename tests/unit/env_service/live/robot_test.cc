// SPDX-License-Identifier: Apache-2.0
// A robot as its topics show it, over the in-process middleware.
#include "env_service/live/robot.h"

#include <tuple>

#include "core/task/action.h"
#include "core/util/wall_clock.h"
#include "tests/unit/env_service/live/robot_fixture.h"

namespace citylearn::testing {
namespace {

/// A robot that looks around.
struct LookingRobot : RobotTest {
  LookingRobot() { robot.look(); }
  Robot robot = make(options());
};

TEST_F(LookingRobot, LooksWhereItStands) {
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

TEST_F(LookingRobot, DrivesStopsAndLooksAgain) {
  send(10, 6);
  ASSERT_TRUE(seen_by(robot));
  commands();
  auto steps = world_.subscribe<std_msgs::msg::dds_::UInt8_>("/citylearn/command");
  robot.drive(kPrevious, 3, 2);
  send(10.1, 5);  // on the way
  EXPECT_FALSE(seen_by(robot, milliseconds(100))) << "what was taken on the way does not count";
  const std::vector<double> speeds = commands();
  ASSERT_GE(speeds.size(), 2u);
  EXPECT_EQ(speeds.front(), -100);
  EXPECT_EQ(speeds.back(), 0);
  std_msgs::msg::dds_::UInt8_ step;
  ASSERT_TRUE(steps.take(step));
  EXPECT_EQ(step.data(), kPrevious);
  EXPECT_FALSE(steps.take(step)) << "once: a robot that does its steps itself would do two";
  send(10.55, 4);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "less than 0.5 s after the last one that may show the way";
  send(10.7, 4);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->place, 2);
  EXPECT_EQ(seen->frame, kPlaces + 1);
}

TEST_F(LookingRobot, PicturesThatComeTwiceLateOrBrokenAreCounted) {
  send_pose(10, 6);
  send_picture(10, "no picture");
  EXPECT_FALSE(seen_by(robot, milliseconds(20)));
  send_picture(10.5, file_);
  send_picture(10.5, file_);
  send_picture(10.2, file_);
  ASSERT_TRUE(seen_by(robot));
  seen_by(robot, milliseconds(20));
  EXPECT_EQ(robot.senses().picture_faults().came(), 4u);
  EXPECT_EQ(robot.senses().picture_faults().used(), 1u);
  EXPECT_EQ(
      robot.senses().picture_faults().text(),
      "/camera/compressed came late (1 message), came twice (1 message), has format '': neither a JPEG, PNG, PNM nor "
      "BMP file (1 message)");
  robot.look();
  send_pose(11, 6);
  send_picture(2, file_);
  EXPECT_TRUE(seen_by(robot)) << "a robot that has started again, without the time";
}

TEST_F(LookingRobot, SaysWhatItWaitsFor) {
  const auto later = [] { return Clock::now() + seconds(4); };
  EXPECT_EQ(robot.trouble(Clock::now()), "");
  EXPECT_EQ(robot.trouble(later()), "nobody publishes sensor_msgs/msg/CompressedImage on /camera/compressed");
  send_picture(10, "no picture");
  seen_by(robot, milliseconds(20));
  EXPECT_EQ(robot.trouble(later()), "/camera/compressed has format '': neither a JPEG, PNG, PNM nor BMP file");
  send_picture(11, file_);
  seen_by(robot, milliseconds(20));
  EXPECT_EQ(robot.trouble(later()), "nobody publishes geometry_msgs/msg/PoseStamped on /pose");
  send_pose(11, 0);
  ASSERT_TRUE(seen_by(robot));
  EXPECT_EQ(robot.trouble(later()), "");
}

TEST_F(RobotTest, SaysWhyPositionsAreNotUsed) {
  const Log log;
  Robot robot = make(with_fixes());
  robot.look();
  send_picture(10, file_);
  for (int i = 0; i < 3; ++i) send_fix("/fix", 10 + 0.1 * i, -1, kNan, kNan);
  send_fix("/fix", 10.3, 0, kNan, 11);
  send_fix("/fix", 10.4, 0, 45, -kInfinite);
  send_fix("/fix", 10.5, 0, 90.5, 11);
  send_fix("/fix", 10.6, 0, 45, 180.5);
  send_fix("/fix", 10.7, 0, 0, 0);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "it is nowhere";
  EXPECT_EQ(
      robot.trouble(Clock::now() + seconds(4)),
      "/fix has no fix, is NaN or infinite, is at 0,0, where receivers without a fix are, is beyond latitude 90 or "
      "longitude 180");
  EXPECT_EQ(
      robot.senses().position_faults().text(),
      "/fix has no fix (3 messages), is NaN or infinite (2 messages), is at 0,0, where receivers without a fix are "
      "(1 message), is beyond latitude 90 or longitude 180 (2 messages)");
  EXPECT_EQ(occurrences(log.text(), "/fix: a message is not used: it "), 4) << "each reason once: " << log.text();
  send_fix("/fix", 11, 0, 45, 11.00006);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->place, 3);
}

TEST_F(RobotTest, OdometryIsCheckedLikewise) {
  PositionTopic topic(world_, "/odom", PositionSource::kOdometry, Profile::kRos2);
  Ros2Participant robot(ros_, "wheels", nullptr);
  nav_msgs::msg::dds_::Odometry_ odometry;
  odometry.header().frame_id("odom");
  odometry.pose().covariance()[7] = 101;  // of y: 10.05 m
  for (const double x : {kNan, 1.5}) {
    odometry.pose().pose().position().x(x);
    robot.publish("/odom", odometry);
    stamp(odometry.header(), 7);
  }
  std::vector<PositionTopic::Position> came;
  topic.take([&](const PositionTopic::Position& position) { came.push_back(position); });
  ASSERT_EQ(came.size(), 2u);
  EXPECT_EQ(came[0].fault, "is NaN or infinite");
  EXPECT_EQ(came[1].fault, "");
  EXPECT_EQ(came[1].x, 1.5);
  EXPECT_EQ(came[1].frame, "odom");
  EXPECT_EQ(came[1].stamp, 7'000'000'000u);
  EXPECT_EQ(came[1].doubt, "may be 10 m off or more, by its covariance");
}

// Places are 2 m apart: a standard deviation of over 20 m says that it is nowhere.
TEST_F(LookingRobot, PositionsThatSayThatTheyAreUselessAreNotUsed) {
  const Log log;
  Ros2Participant receiver(ros_, "receiver", nullptr);
  RobotTopics topics = options().topics;
  topics.source = PositionSource::kPoseWithCovariance;
  topics.position = "/amcl_pose";
  RobotSenses senses(receiver, topics);
  senses.limit_deviation(20);
  auto used = [&, seconds = 0.0](double x, double y) mutable {
    geometry_msgs::msg::dds_::PoseWithCovarianceStamped_ pose;
    stamp(pose.header(), ++seconds);
    pose.pose().covariance()[0] = x;
    pose.pose().covariance()[7] = y;
    world_.publish("/amcl_pose", pose);
    senses.poll();
    return senses.position() && senses.position()->stamp == static_cast<std::uint64_t>(1e9 * seconds);
  };
  EXPECT_TRUE(used(0, 0)) << "it is not known";
  EXPECT_TRUE(used(-1, 500)) << "likewise";
  EXPECT_TRUE(used(500, kNan)) << "likewise";
  EXPECT_TRUE(used(400, 99));
  EXPECT_FALSE(used(401, 0));
  EXPECT_FALSE(used(0, kInfinite));
  EXPECT_TRUE(used(1, 1));
  EXPECT_EQ(
      senses.position_faults().text(),
      "/amcl_pose may be 10 m off or more, by its covariance (1 message), may be over 20 m off, by its covariance "
      "(2 messages)");
  EXPECT_EQ(occurrences(log.text(), "/amcl_pose: a message is not used: it may be over 20 m off, by its covariance"),
            1);

  nav_msgs::msg::dds_::Odometry_ odometry;
  Fix fix;
  fix.latitude(45);
  odometry.pose().covariance()[7] = fix.position_covariance()[4] = 401;
  EXPECT_EQ(position_of(odometry).variance, 401);
  EXPECT_EQ(position_of(fix).variance, 0) << "its covariance is of type 0, not known";
  fix.position_covariance_type(2);
  EXPECT_EQ(position_of(fix).variance, 401);

  send(1, 4);  // what has no covariance
  EXPECT_TRUE(seen_by(robot));
}

TEST_F(LookingRobot, PositionsOfAnotherFrameOrTimeAreNotUsed) {
  const Log log;
  send_picture(10, file_);
  for (const auto& [seconds, frame, x] : std::vector<std::tuple<double, std::string, double>>{
           {10, "/map", 6}, {11, "odom", 2}, {10.5, "map", 2}, {11, "", 8}}) {
    Pose pose;
    stamp(pose.header(), seconds);
    pose.header().frame_id(frame);
    pose.pose().position().x(x);
    pose.pose().position().y(5);
    world_.publish("/pose", pose);
    robot.poll(Clock::now());
  }
  EXPECT_TRUE(log.has("/pose: a message is not used: it is in frame 'odom', the first in 'map'")) << log.text();
  EXPECT_EQ(occurrences(log.text(), "not used"), 1) << "10.5 s came before 11 s of frame odom: " << log.text();
  robot.look();
  send_picture(12, file_);
  send_pose(10.9, 0);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "it comes late";
  EXPECT_EQ(robot.trouble(Clock::now() + seconds(4)), "/pose came late, is in frame 'odom', the first in 'map'");
  send_pose(12, 4);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen);
  EXPECT_EQ(seen->place, 2);
}

TEST_F(RobotTest, GoalsThatAreNoPlaceAreRefused) {
  const Log log;
  RobotOptions with_goals = options();
  with_goals.goal = "/goal";
  Robot robot = make(with_goals);
  robot.publish_status("waiting");
  send_pose(10, 0);
  robot.poll(Clock::now());
  said();
  for (const double x : {kNan, kInfinite, -kInfinite, 1e9, 1e4}) {
    send_goal(x);
    EXPECT_EQ(goals_of(robot), std::vector<int>()) << x;
    EXPECT_EQ(said(), std::vector<std::string>{"refused"}) << x;
  }
  EXPECT_EQ(occurrences(log.text(), "a goal on /goal is refused: it is no position: it is NaN or infinite"), 3);
  EXPECT_EQ(occurrences(log.text(), "it is no position: it is over 100,000 km from the origin"), 1);
  EXPECT_EQ(occurrences(log.text(), "a goal on /goal is refused: it is 9982 m from the nearest place"), 1)
      << log.text();
  send_goal(4);
  send_goal(kNan);
  send_goal(12);
  send_goal(12);
  EXPECT_EQ(goals_of(robot), (std::vector{2, 6, 6})) << "each is answered";
  EXPECT_EQ(said(), std::vector<std::string>{"refused"});
}

TEST_F(RobotTest, GoalsInAnotherFrameOrWithoutAFixAreRefused) {
  const Log log;
  RobotOptions with_goals = options();
  with_goals.goal = "/goal";
  {
    Robot robot = make(with_goals);
    Pose pose;
    pose.header().frame_id("map");
    world_.publish("/pose", pose);
    robot.poll(Clock::now());
    send_goal(4, "odom");
    send_goal(4, "");
    EXPECT_EQ(goals_of(robot), std::vector{2}) << "one without a frame is taken as one of the robot's";
    EXPECT_TRUE(log.has("a goal on /goal is refused: it is in frame 'odom', the robot's position in 'map'"))
        << log.text();
  }
  Robot robot = make(with_fixes());
  said();
  send_fix("/goal_fix", 1, -1, 45, 11);
  send_fix("/goal_fix", 2, 0, kNan, 11);
  send_fix("/goal_fix", 3, 0, 0, 0);
  send_fix("/goal_fix", 4, 0, 45, 11.00004);
  EXPECT_EQ(goals_of(robot), std::vector{2});
  EXPECT_EQ(said(), std::vector<std::string>(3, "refused"));
  EXPECT_TRUE(log.has("a goal on /goal_fix is refused: it is no position: it has no fix")) << log.text();
}

TEST_F(RobotTest, ServicesSendItToGoalsAndSayTheWay) {
  using Request = nav_msgs::srv::dds_::GetPlan_Request_;
  using Client = Ros2Client<Request, nav_msgs::srv::dds_::GetPlan_Response_>;
  const Log log;
  RobotOptions with_goals = options();
  with_goals.goal = "/goal";
  Robot robot = make(with_goals);
  Client set_goal(ros_, "/citylearn/robot/set_goal"), get_plan(ros_, "/citylearn/robot/get_plan");
  Pose here;
  stamp(here.header(), 10);
  here.header().frame_id("map");
  here.pose().position().x(8);
  world_.publish("/pose", here);
  robot.poll(Clock::now());
  int sent = -1;
  std::string refusal;
  /// Returns the x of the places to a goal, in the order of the way.
  const auto way = [&](Client& client, double start, double goal, double tolerance = 0, const char* frame = "map") {
    Request request;
    request.goal().header().frame_id(frame);
    request.start().pose().position().x(start);
    request.goal().pose().position().x(goal);
    request.start().pose().position().y(5);
    request.goal().pose().position().y(5);
    request.tolerance(static_cast<float>(tolerance));
    client.call(request);
    robot.take_goals([&](int& place) {
      sent = place;
      if (place == 7) place = 6;  // the task's route ends there
      return refusal;
    });
    const auto reply = client.reply();
    EXPECT_TRUE(reply);
    std::vector<double> x;
    for (const auto& pose : reply->plan().poses()) {
      EXPECT_EQ(pose.pose().position().y(), 5);
      EXPECT_EQ(pose.header().frame_id(), "map");
      x.push_back(pose.pose().position().x());
    }
    return x;
  };
  using Way = std::vector<double>;
  EXPECT_EQ(way(set_goal, 0, 3.2), (Way{8, 6, 4})) << "from where it is";
  EXPECT_EQ(sent, 2);
  EXPECT_EQ(way(set_goal, 0, 14), (Way{8, 10, 12}));
  EXPECT_EQ(way(set_goal, 0, 8), Way{8});
  said();
  sent = -1;
  EXPECT_EQ(way(set_goal, 0, kNan), Way());
  EXPECT_EQ(way(set_goal, 0, 4, 0, "odom"), Way());
  EXPECT_EQ(way(set_goal, 0, 5, 0.5), Way()) << "no place is so near";
  EXPECT_EQ(sent, -1);
  refusal = "nobody drives";
  EXPECT_EQ(way(set_goal, 0, 4), Way());
  EXPECT_EQ(said(), std::vector<std::string>(4, "refused"));
  EXPECT_TRUE(log.has("a goal on ~/set_goal is refused: nobody drives")) << log.text();
  sent = -1;
  EXPECT_EQ(way(get_plan, 4, 0.3), (Way{4, 2, 0}));
  EXPECT_EQ(way(get_plan, 1e4, 0), Way());
  EXPECT_EQ(way(get_plan, 0, kInfinite), Way());
  EXPECT_TRUE(log.has("~/get_plan: no plan begins there: it is 9982 m from the nearest place")) << log.text();
  EXPECT_TRUE(log.has("~/get_plan: no plan leads there: it is no position: it is NaN or infinite")) << log.text();
  EXPECT_EQ(sent, -1) << "it drives nowhere";
}

TEST_F(LookingRobot, FarFromItsRouteItStandsAndSaysSo) {
  send(10, 1e5);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "no place is near";
  EXPECT_EQ(robot.trouble(Clock::now() + seconds(4)), "it stands 99982 m from the nearest place that it was taught");
  send_pose(10.5, 9e4);
  EXPECT_FALSE(seen_by(robot, milliseconds(20)));
  EXPECT_EQ(robot.trouble(Clock::now() + seconds(4)), "it stands 99982 m from the nearest place that it was taught")
      << "one alarm, not one for each metre";
  send_pose(11, 37);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen) << "19 m beyond the last place, less than ten times the distance of two";
  EXPECT_EQ(seen->place, kPlaces - 1);
  EXPECT_EQ(robot.trouble(Clock::now() + seconds(4)), "");
}

TEST_F(RobotTest, HowFarItMayBeFromItsRouteCanBeSaid) {
  RobotOptions near = options();
  near.off_route = 5;
  Robot robot = make(near);
  robot.look();
  send(10, 37);
  EXPECT_FALSE(seen_by(robot, milliseconds(20))) << "19 m beyond the last place";
  EXPECT_EQ(robot.trouble(Clock::now() + seconds(4)), "it stands 19 m from the nearest place that it was taught");
}

TEST_F(RobotTest, ClocksThatCannotBeAreToldOnce) {
  const Log log;
  Robot robot = make(options());
  for (int i = 0; i < 4; ++i) {  // two cameras on one topic
    send_picture(1000 + i, file_);
    send_picture(10 + i, file_);
  }
  robot.poll(Clock::now());
  EXPECT_EQ(occurrences(log.text(), "a clock was set back, or two cameras send"), 1) << log.text();
  for (int i = 0; i < 4; ++i) send_pose(0, 6);
  robot.poll(Clock::now());
  EXPECT_EQ(occurrences(log.text(), "/pose: a message is used: it has no stamp: the time of its arrival counts"), 1);
}

/// A robot whose time comes on /clock, and which drives 2 m in 2 s.
struct SimulatedTime : RobotTest {
  RobotOptions simulated() const {
    RobotOptions result = options();
    result.ros.use_sim_time = true;
    result.speed = 1;
    return result;
  }
  /// Returns what it was commanded since the last call, once it has heard the time.
  std::vector<double> commands_at(double time) {
    send_time(time);
    robot.poll(Clock::now());
    robot.poll(Clock::now());
    return commands();
  }
  Robot robot = make(simulated());
  const Clock::time_point much_later = Clock::now() + std::chrono::hours(1);
};

TEST_F(SimulatedTime, ItStandsUntilItIsKnown) {
  robot.look();
  send(10, 6);
  EXPECT_FALSE(seen_by(robot, milliseconds(20)));
  send_time(10);
  EXPECT_TRUE(seen_by(robot));
}

TEST_F(SimulatedTime, NothingIsLateWhileItStandsStill) {
  send_time(10);
  robot.look();
  send(10, 6);
  ASSERT_TRUE(seen_by(robot));
  commands();
  robot.drive(kNext, 3, 4);
  EXPECT_EQ(commands(), std::vector<double>{1});
  for (int times = 0; times < 3; ++times) robot.poll(much_later);
  EXPECT_EQ(commands(), std::vector<double>()) << "a robot's watchdog goes by the same time";
  EXPECT_EQ(commands_at(11.75), std::vector<double>{1}) << "one may be lost";
  EXPECT_EQ(commands_at(12.25), std::vector<double>{0}) << "it has driven for 2 s";
  EXPECT_EQ(robot.trouble(much_later), "");
  send_time(15);
  robot.poll(much_later);
  EXPECT_EQ(robot.trouble(much_later), "") << "2.75 s after it stopped";
  send_time(15.5);
  robot.poll(much_later);
  EXPECT_EQ(robot.trouble(much_later), "nothing comes on /camera/compressed");
}

TEST_F(SimulatedTime, WhatCameBeforeItWasSetBackIsForgotten) {
  send_time(10);
  robot.look();
  send(10, 6);
  ASSERT_TRUE(seen_by(robot));
  robot.look();
  send_time(8);
  EXPECT_FALSE(seen_by(robot, milliseconds(20)));
  send(8, 4);
  const auto seen = seen_by(robot);
  ASSERT_TRUE(seen) << "2 s earlier than the last one";
  EXPECT_EQ(seen->place, 2);
  EXPECT_EQ(robot.senses().picture_faults().used(), 2u);
}

TEST_F(SimulatedTime, IsThatOfMessagesWithoutAStamp) {
  send_time(10);
  robot.look();
  send(0, 6);
  ASSERT_TRUE(seen_by(robot));
  EXPECT_EQ(robot.senses().picture()->stamp, 10'000'000'000u);
  EXPECT_EQ(robot.senses().position()->stamp, 10'000'000'000u);
}

TEST_F(RobotTest, WrongOptionsAreOneClearError) {
  const auto expect = [&](const RobotOptions& wrong, const std::string& text) {
    EXPECT_TRUE(contains(error_of([&] { make(wrong); }), text));
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
