// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/robot.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/ros2/header.h"
#include "core/util/error.h"

namespace citylearn {
namespace {

using std::chrono::milliseconds;

using Twist = geometry_msgs::msg::dds_::Twist_;
using Command = std_msgs::msg::dds_::UInt8_;
using Status = std_msgs::msg::dds_::String_;

constexpr milliseconds kCommandInterval{50};  // robots stop by themselves when commands cease
constexpr milliseconds kPollInterval{5};      // between looks at what has come, while something is awaited
constexpr milliseconds kIdleInterval{100};    // likewise, while nothing is
constexpr std::chrono::seconds kTroubleDelay{3};
constexpr std::chrono::seconds kStatusInterval{1};

RobotOptions named(RobotOptions options) {
  if (options.topics.position.empty())
    throw Error("the topic that says where the robot is is missing", "--position",
                "as /odom: it is how an episode knows that the goal is reached");
  options.cmd_vel = ros2_topic(options.cmd_vel, "--cmd-vel");
  options.command = ros2_topic(options.command, "--command");
  if (!options.goal.empty()) options.goal = ros2_topic(options.goal, "--goal");
  options.status = ros2_topic(options.status, "--status");
  return options;
}

/// Returns the coordinates of places, or throws Error when they have none of this kind.
const std::vector<double>& known(const std::vector<double>& values, const Traversal& taught, const char* columns) {
  if (std::any_of(values.begin(), values.end(), [](double value) { return std::isfinite(value); })) return values;
  throw Error(std::string("its places have no ") + columns, "traversal '" + taught.name + "'",
              "teach it with --position, or give it a poses.csv with these columns");
}

}  // namespace

Robot::Robot(const RobotOptions& options, const std::string& name, const MiddlewareOptions& own,
             const Traversal& taught, LiveImages& images)
    : options_(named(options)),
      taught_(taught),
      images_(images),
      ros_(options_.ros, name, &own),
      senses_(ros_, options_.topics),
      x_(options_.topics.source == PositionSource::kFix ? known(taught.latitude, taught, "lat and lon")
                                                        : known(taught.x, taught, "x and y")),
      y_(options_.topics.source == PositionSource::kFix ? taught.longitude : taught.y) {
  std::vector<double> gaps;
  for (std::size_t i = 1; i < taught.positions.size(); ++i)
    if (const double gap = taught.positions[i] - taught.positions[i - 1]; gap > 0) gaps.push_back(gap);
  if (gaps.empty()) throw Error("all of its places are the same", "traversal '" + taught.name + "'");
  std::nth_element(gaps.begin(), gaps.begin() + static_cast<std::ptrdiff_t>(gaps.size() / 2), gaps.end());
  spacing_ = gaps[gaps.size() / 2];
  senses_.limit_deviation(kMaxPlacesAway * spacing_);
  max_away_ = options_.off_route > 0 ? options_.off_route : kMaxPlacesAway * spacing_;
  ros_.advertise<Twist>(options_.cmd_vel);
  ros_.advertise<Command>(options_.command);
  const bool fix = options_.topics.source == PositionSource::kFix;  // a plan is of poses
  if (!fix) get_plan_ = ros_.offer<PlanRequest, PlanResponse>("get_plan");
  if (options_.goal.empty()) return;
  if (!fix) set_goal_ = ros_.offer<PlanRequest, PlanResponse>("set_goal");
  goals_.emplace(ros_, options_.goal, fix ? PositionSource::kFix : PositionSource::kPose, Profile::kRos2Reliable);
  ros_.advertise<Status>(options_.status);
}

Robot::~Robot() {
  try {
    stop();
  } catch (const Error& error) {
    spdlog::error("the robot could not be told to stop: {}", error.what());
  }
}

void Robot::command(double speed) {
  speed_ = speed;
  next_command_ = ros_.now() + kCommandInterval;
  Twist twist;
  twist.linear().x(speed);
  ros_.publish(options_.cmd_vel, twist);
}

double Robot::metres_between_places(int from, int to) const {
  const double metres =
      std::abs(taught_.positions[static_cast<std::size_t>(to)] - taught_.positions[static_cast<std::size_t>(from)]);
  return metres > 0 ? metres : spacing_ * std::abs(to - from);  // unknown ones too
}

void Robot::drive(std::uint8_t action, int from, int to) {
  Command step;
  step.data(action);
  ros_.publish(options_.command, step);
  if (from == to) return begin_to_look(0);
  const double metres = metres_between_places(from, to);
  doing_ = Doing::kDriving;
  until_ =
      ros_.now() + std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(metres / options_.speed));
  command(to > from ? options_.speed : -options_.speed);
  due_ = Clock::now();
}

void Robot::look() {
  const bool drove = speed_ != 0;
  command(0);
  begin_to_look(drove ? static_cast<std::uint64_t>(1e9 * options_.settle) : 0);
}

void Robot::stop() {
  doing_ = Doing::kNothing;
  command(0);
}

/// Begins to wait for a picture and a position, each at least `settle` nanoseconds newer than the last one.
void Robot::begin_to_look(std::uint64_t settle) {
  senses_.poll();
  doing_ = Doing::kLooking;
  looking_ = ros_.now();
  due_ = Clock::now();
  picture_after_ = senses_.picture() ? senses_.picture()->stamp + settle : 0;
  position_after_ = senses_.position() ? senses_.position()->stamp + settle : 0;
}

std::optional<Sighting> Robot::poll(Clock::time_point now) {
  for (const std::string& fault : ros_.poll()) {
    spdlog::error("{}", fault);
    if (goals_ && fault.starts_with("topic rt" + goals_->name() + ":")) refuse_goal("it is of another type");
  }
  if (senses_.poll()) picture_after_ = position_after_ = 0;
  if (!status_.empty() && now >= next_status_) publish_status(status_);
  const Clock::time_point ros_now = ros_.clock().at(now);
  if (doing_ == Doing::kDriving && ros_now >= until_) look();
  if (doing_ == Doing::kLooking && ros_.clock().known() && has_picture() && has_position()) {
    const auto [place, metres] = nearest_place(*senses_.position());
    if (metres <= max_away_) {
      off_route_ = 0;
      doing_ = Doing::kNothing;
      return Sighting{place, images_.add(senses_.picture()->file)};
    }
    if (off_route_ == 0) off_route_ = metres;  // an alarm that does not change with each message
  }
  if (doing_ != Doing::kNothing && ros_now >= next_command_) command(speed_);  // one may be lost
  due_ = now + (doing_ == Doing::kNothing ? kIdleInterval : kPollInterval);
  if (doing_ == Doing::kDriving && !ros_.clock().simulated()) due_ = std::min({due_, until_, next_command_});
  return std::nullopt;
}

/// Returns the nearest place and its distance in metres.
std::pair<int, double> Robot::nearest_place(const PositionTopic::Position& position) const {
  std::pair<int, double> nearest = {0, std::numeric_limits<double>::infinity()};
  for (std::size_t place = 0; place < x_.size(); ++place) {
    const double metres = PositionTopic::metres_between(options_.topics.source, position, {0, x_[place], y_[place]});
    if (metres < nearest.second) nearest = {static_cast<int>(place), metres};
  }
  return nearest;
}

std::variant<int, std::string> Robot::place_of(const PositionTopic::Position& position, double tolerance) const {
  if (!position.fault.empty()) return "it is no position: it " + position.fault;
  if (!position.frame.empty() && !senses_.frame().empty() && position.frame != senses_.frame())
    return "it is in frame '" + position.frame + "', the robot's position in '" + senses_.frame() + "'";
  const auto [place, metres] = nearest_place(position);
  if (metres > (tolerance > 0 ? std::min(tolerance, max_away_) : max_away_))
    return fmt::format("it is {:.0f} m from the nearest place that was taught", metres);
  return place;
}

void Robot::take_goals(const std::function<std::string(int& place)>& send) {
  const auto send_to = [&](const PositionTopic::Position& goal, double tolerance, const std::string& where) {
    auto place = place_of(goal, tolerance);
    if (int* const sent = std::get_if<int>(&place))
      if (const std::string why = send(*sent); !why.empty()) place = why;
    if (const auto* why = std::get_if<std::string>(&place)) refuse_goal(*why, where);
    return place;
  };
  if (goals_) goals_->take([&](const PositionTopic::Position& goal) { send_to(goal, 0, ""); });
  if (set_goal_)
    set_goal_->serve([&](const PlanRequest* request) {
      if (!request) return PlanResponse();
      const auto place = send_to(position_of(request->goal()), request->tolerance(), "~/set_goal");
      const int* const goal = std::get_if<int>(&place);
      return goal ? plan(senses_.position() ? nearest_place(*senses_.position()).first : *goal, *goal) : PlanResponse();
    });
  if (get_plan_)
    get_plan_->serve([&](const PlanRequest* request) {
      if (!request) return PlanResponse();
      const auto from = place_of(position_of(request->start()), request->tolerance()),
                 to = place_of(position_of(request->goal()), request->tolerance());
      for (const auto* end : {&from, &to})
        if (const auto* why = std::get_if<std::string>(end)) {
          spdlog::warn("~/get_plan: no plan {} there: {}", end == &to ? "leads" : "begins", *why);
          return PlanResponse();
        }
      return plan(std::get<int>(from), std::get<int>(to));
    });
}

/// Returns the places of the route from one to another.
Robot::PlanResponse Robot::plan(int from, int to) const {
  PlanResponse response;
  response.plan().header(ros2_header(senses_.frame(), ros_.clock().time()));
  for (int place = from, step = to < from ? -1 : 1; place != to + step; place += step) {
    const auto index = static_cast<std::size_t>(place);
    if (!std::isfinite(x_[index]) || !std::isfinite(y_[index])) continue;
    auto& pose = response.plan().poses().emplace_back();
    pose.header(response.plan().header());
    pose.pose().position().x(x_[index]);
    pose.pose().position().y(y_[index]);
    pose.pose().orientation().w(1);
  }
  return response;
}

void Robot::refuse_goal(const std::string& why, const std::string& where) {
  spdlog::warn("a goal on {} is refused: {}", where.empty() ? goals_->name() : where, why);
  publish_status_once("refused");
}

void Robot::publish_status_once(const std::string& status) {
  const std::string before = status_;
  publish_status(status);
  status_ = before;
}

void Robot::publish_status(const std::string& status) {
  if (status != status_) spdlog::info("robot: {}", status);
  status_ = status;
  next_status_ = Clock::now() + kStatusInterval;
  Status message;
  message.data(status);
  ros_.publish(options_.status, message);
}

std::string Robot::trouble(Clock::time_point now) const {
  if (!ros_.clock().trouble().empty()) return "it waits for the time: " + ros_.clock().trouble();
  if (doing_ != Doing::kLooking || ros_.clock().at(now) < looking_ + kTroubleDelay) return "";
  if (!has_picture()) return senses_.why_no_picture(false);
  if (!has_position()) return senses_.why_no_position(false);
  return fmt::format("it stands {:.0f} m from the nearest place that it was taught", off_route_);
}

}  // namespace citylearn
