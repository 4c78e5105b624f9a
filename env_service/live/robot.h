// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "core/util/types.h"
#include "env_service/live/live_images.h"
#include "env_service/live/position_topic.h"
#include "env_service/live/robot_options.h"
#include "env_service/live/robot_senses.h"
#include "env_service/live/sighting.h"
#include "env_service/traversal/traversal.h"

namespace citylearn {

/// A robot on a route that it was taught. It drives a step, stops, and then says where it is and what it sees. It
/// stands whenever nothing is asked of it. A picture or a position that does not come is waited for. Used by one
/// thread.
class Robot {
 public:
  /// `taught` and `images` (of it) must outlive it. `own`: how this process meets CityLearn's services. Throws Error
  /// when no topic is given, places do not say where they are in what positions are in, or the middleware cannot start.
  Robot(const RobotOptions& options, const std::string& name, const MiddlewareOptions& own, const Traversal& taught,
        LiveImages& images);
  ~Robot();

  /// Drives from one place to another, then looks. Equal places: it stands. `action` is for robots that do their steps
  /// themselves.
  void drive(std::uint8_t action, int from, int to);
  /// Stops where it is, then looks.
  void look();
  /// Stops where it is.
  void stop();

  /// Does what is due. Returns what it saw, once for each look.
  std::optional<Sighting> poll(Clock::time_point now);
  /// Returns when poll() is to be called again.
  Clock::time_point due() const { return due_; }
  /// Returns whether it subscribes to a topic of goals.
  bool has_goal_topic() const { return goals_.has_value(); }
  /// Calls `send` with each place to which it was sent since the last call. This returns why it is refused, or nothing,
  /// and may move it. A goal that is not on the route is refused. Answers the services ~/set_goal and ~/get_plan.
  void take_goals(const std::function<std::string(int& place)>& send);
  /// Publishes that the goal is refused, and logs why. `where` it came: the topic of goals, if empty.
  void refuse_goal(const std::string& why, const std::string& where = "");
  /// Publishes a status once; the status is then as it was.
  void publish_status_once(const std::string& status);
  /// Publishes what becomes of the goal, now and once a second.
  void publish_status(const std::string& status);
  /// Returns what it has been waiting for, for more than three seconds by its clock: "nobody publishes
  /// /camera/image_raw"; else "".
  std::string trouble(Clock::time_point now) const;
  const RobotOptions& options() const { return options_; }
  const RobotSenses& senses() const { return senses_; }

 private:
  enum class Doing { kNothing, kDriving, kLooking };
  using PlanRequest = nav_msgs::srv::dds_::GetPlan_Request_;
  using PlanResponse = nav_msgs::srv::dds_::GetPlan_Response_;

  void command(double speed);
  void begin_to_look(std::uint64_t settle);
  bool has_picture() const {
    return senses_.picture() && RobotSenses::follows(senses_.picture()->stamp, picture_after_);
  }
  bool has_position() const {
    return senses_.position() && RobotSenses::follows(senses_.position()->stamp, position_after_);
  }
  double metres_between_places(int from, int to) const;
  std::pair<int, double> nearest_place(const PositionTopic::Position& position) const;
  /// Returns the place at which a goal or a start is, or why it is none.
  std::variant<int, std::string> place_of(const PositionTopic::Position& position, double tolerance) const;
  PlanResponse plan(int from, int to) const;

  const RobotOptions options_;
  const Traversal& taught_;
  LiveImages& images_;
  Ros2Participant ros_;
  RobotSenses senses_;
  std::optional<PositionTopic> goals_;
  std::optional<Ros2Service<PlanRequest, PlanResponse>> set_goal_, get_plan_;
  const std::vector<double>&x_, &y_;  // of the places, as positions come
  double spacing_ = 0;                // metres between places, median
  double max_away_ = 0;               // metres from the nearest place at which it still drives
  double off_route_ = 0;              // metres from the nearest place, when that became far; else 0

  std::string status_;
  Clock::time_point next_status_;
  Doing doing_ = Doing::kNothing;
  double speed_ = 0;                                  // now, m/s
  Clock::time_point until_, next_command_, looking_;  // by its clock; until_: of driving
  Clock::time_point due_;
  std::uint64_t picture_after_ = 0, position_after_ = 0;  // stamps: what comes with later ones counts
};

}  // namespace citylearn
