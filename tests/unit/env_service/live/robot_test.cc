// SPDX-License-Identifier: Apache-2.0
// A robot as its topics show it, over the in-process middleware.
#include "env_service/live/robot.h"

#include <gtest/gtest.h>

#include <limits>
#include <tuple>

#include "core/task/action.h"
#include "core/util/wall_clock.h"
#include "env_service/live_steps.h"
#include "tests/support/data/fake_images.h"
#include "tests/support/data/pictures.h"
#include "tests/support/env/env.h"
#include "tests/support/log.h"
#include "tests/support/options.h"
#include "tests/support/processes/domain.h"
#include "tests/support/processes/service.h"
#include "tests/support/ros2_client.h"
#include "tests/support/text.h"

namespace citylearn::testing {
namespace {

using Picture = sensor_msgs::msg::dds_::CompressedImage_;
using Fix = sensor_msgs::msg::dds_::NavSatFix_;
using Pose = geometry_msgs::msg::dds_::PoseStamped_;
using Twist = geometry_msgs::msg::dds_::Twist_;

constexpr int kPlaces = 10;
constexpr double kMetres = 2;  // between places

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
  void send(double seconds, double x) {
    send_picture(seconds, file_);
    send_pose(seconds, x);
  }
  void send_fix(const std::string& topic, double seconds, int status, double latitude, double longitude) {
    Fix fix;
    stamp(fix.header(), seconds);
    fix.status().status(static_cast<std::uint8_t>(status));
    fix.latitude(latitude);
    fix.longitude(longitude);
    world_.publish(topic, fix);
  }
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

constexpr double kNan = std::numeric_limits<double>::quiet_NaN(), kInfinite = std::numeric_limits<double>::infinity();

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

/// A robot that a policy_service may drive and others send to goals.
class SentToGoals : public RobotTest {
 protected:
  SentToGoals() {
    RobotOptions with_goals = options();
    with_goals.goal = "/goal";
    steps_.emplace(environment_, std::make_unique<Robot>(with_goals, "robot", own_, taught_, images_));
    tasks_.tasks() = 2;
    send_goal(0);
    EXPECT_FALSE(steps_->advance(Clock::now()));
    EXPECT_EQ(said(), (std::vector<std::string>{"stopped", "refused"})) << "nobody drives it";
  }
  /// The robot is seen at a place, again and again, until what has begun is done.
  void advance(int place) {
    const auto done = [&] {
      send(++now_, kMetres * place);
      return steps_->advance(Clock::now()) || !steps_->busy() || steps_->awaits_goal();
    };
    EXPECT_TRUE(poll_until(done, milliseconds(5000)));
  }
  /// `lost`: the probability of it, as the agent believes.
  void step(std::uint8_t action, float lost = 0, std::uint32_t likeliest = 3) {
    msg::Belief belief;
    belief.likely() = {likeliest, 4, 5, 6, 7, 8, 9, 0};
    belief.lost() = {lost};
    steps_->step(std::span(&action, 1), belief);
  }

  Environment environment_{taught_, 1};
  std::optional<LiveSteps> steps_;
  msg::TaskSettings tasks_ = settings(msg::EVALUATE, kPlaces, 100);
  double now_ = 10;
};

TEST_F(SentToGoals, EveryGoalIsAnswered) {
  steps_->reset(tasks_);
  send_goal(kMetres * 4);  // before the robot was seen
  send_goal(kMetres * 4);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), std::vector<std::string>{"replaced 4"});
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"driving 6"});
  send_goal(kMetres * 8);
  send_goal(kMetres * 6);
  send_goal(kNan);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), (std::vector<std::string>{"replaced 8", "refused"})) << "6 goes on";
  step(kNext);
  advance(6);
  EXPECT_EQ(said(), (std::vector<std::string>{"arrived 6", "waiting"}));
  step(kStay);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  advance(6);
  EXPECT_EQ(said(), std::vector<std::string>{"arrived 6"}) << "it stands there";
}

TEST_F(SentToGoals, StandsWhileItIsLost) {
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  advance(5);
  commands();
  said();
  step(kNext, 0.75f);
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"lost 6"});
  EXPECT_EQ(
      steps_->trouble(Clock::now()),
      "it is lost and stands: with probability 0.75 it is not near place 3, where it is likeliest (--max-lost 0.7)");
  step(kNext, 0.71875f);
  EXPECT_TRUE(contains(steps_->trouble(Clock::now()), "probability 0.75")) << "one alarm, not one a step";
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>());
  for (const double speed : commands()) EXPECT_EQ(speed, 0);
  msg::Observation seen;
  environment_.observe(seen);
  EXPECT_EQ(seen.previous_action()[0], kStay) << "so the filter knows that it stands";
  step(kNext, 0.25f);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
  advance(6);
  EXPECT_EQ(commands().front(), 100);
  EXPECT_EQ(said(), (std::vector<std::string>{"driving 6", "arrived 6", "waiting"}));
  send_goal(kMetres * 8);
  step(kNext, 0, 8);  // what was believed in the last episode is forgotten
  advance(6);
  step(kNext, 0, 5);
  EXPECT_EQ(steps_->trouble(Clock::now()), "") << "a slip leads there";
  advance(6);
  step(kNext, 0.5f, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()),
            "it was lost and stands: it took itself to be near place 5 and is likeliest near 1 (--max-lost 0.7)");
  advance(6);
  step(kNext, 0.5f, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
  advance(8);
  tasks_.task_mode() = msg::TRAIN;
  steps_->reset(tasks_);
  send_goal(kMetres * 8);
  advance(5);
  step(kNext, 1);
  EXPECT_EQ(steps_->trouble(Clock::now()), "") << "what it learns from is what it did";
}

TEST_F(SentToGoals, IsNoLongerLostWhenAnEpisodeEnds) {
  tasks_.max_steps() = 1;
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  advance(5);
  step(kNext, 0.75f);
  advance(5);
  EXPECT_EQ(steps_->trouble(Clock::now()), "");
}

TEST_F(SentToGoals, GoalsAreRefusedWhenNobodyDrivesOnAndWhenTheTasksAreDone) {
  steps_->reset(tasks_);
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  steps_->stop();
  EXPECT_EQ(said(), (std::vector<std::string>{"refused", "stopped"}));
  steps_->reset(tasks_);
  advance(5);
  EXPECT_EQ(said(), std::vector<std::string>{"waiting"});
  steps_->release();  // the policy_service is silent
  send_goal(kMetres * 6);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), (std::vector<std::string>{"stopped", "refused"}));
  step(kStay);  // it is back
  EXPECT_EQ(said(), std::vector<std::string>{"waiting"});
  for (const int goal : {6, 5}) {
    send_goal(kMetres * goal);
    steps_->advance(Clock::now());
    advance(11 - goal);
    step(goal == 6 ? kNext : kPrevious);
    advance(goal);
    if (goal == 6) step(kStay);
  }
  EXPECT_TRUE(environment_.done());
  said();
  send_goal(kMetres * 7);
  steps_->advance(Clock::now());
  EXPECT_EQ(said(), std::vector<std::string>{"refused"});
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
