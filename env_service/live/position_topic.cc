// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/position_topic.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/ros2/header.h"
#include "core/util/text.h"
#include "core/util/wall_clock.h"
#include "env_service/geometry/geometry.h"

namespace citylearn {
namespace {

constexpr double kNullIsland = 1e-3;  // degrees around 0,0
constexpr double kMaxMetres = 1e8;    // from the origin of a frame
constexpr double kMaxVariance = 100;  // square metres

/// Returns why this is not a position; empty when it is one.
const char* fault_of(double x, double y, bool degrees) {
  if (!std::isfinite(x) || !std::isfinite(y)) return "is NaN or infinite";
  if (!degrees) return std::hypot(x, y) > kMaxMetres ? "is over 100,000 km from the origin" : "";
  if (std::abs(x) > 90 || std::abs(y) > 180) return "is beyond latitude 90 or longitude 180";
  return std::hypot(x, y) < kNullIsland ? "is at 0,0, where receivers without a fix are" : "";
}

}  // namespace

std::uint64_t stamp_of(const std_msgs::msg::dds_::Header_& header) {
  const std::uint64_t stamp = ros2_time(header);
  return stamp > 0 ? stamp : nanoseconds_since_epoch();
}

double PositionTopic::metres_between(PositionSource source, const Position& a, const Position& b) {
  return source == PositionSource::kFix ? citylearn::metres_between(a.x, a.y, b.x, b.y)
                                        : std::hypot(a.x - b.x, a.y - b.y);
}

PositionTopic::PositionTopic(Ros2Participant& ros, std::string topic, PositionSource source, Profile profile)
    : topic_(std::move(topic)) {
  switch (source) {
    case PositionSource::kOdometry:
      odometry_ = ros.subscribe<nav_msgs::msg::dds_::Odometry_>(topic_, profile);
      break;
    case PositionSource::kPose:
      pose_ = ros.subscribe<geometry_msgs::msg::dds_::PoseStamped_>(topic_, profile);
      break;
    case PositionSource::kFix:
      fix_ = ros.subscribe<sensor_msgs::msg::dds_::NavSatFix_>(topic_, profile);
      break;
  }
}

void PositionTopic::take(const std::function<void(const Position&)>& use) {
  const auto note = [&](const auto& header, double x, double y, double variance, bool has_fix = true) {
    Position position{stamp_of(header), x, y};
    position.fault = has_fix ? fault_of(x, y, fix_.has_value()) : "has no fix";
    if (!fix_) position.frame = one_line(header.frame_id().substr(header.frame_id().starts_with("/") ? 1 : 0, 40));
    if (ros2_time(header) == 0) position.doubt = "has no stamp: the time of its arrival counts";
    if (variance > kMaxVariance) position.doubt = "may be 10 m off or more, by its covariance";
    use(position);
  };
  for (nav_msgs::msg::dds_::Odometry_ message; odometry_ && odometry_->take(message);)
    note(message.header(), message.pose().pose().position().x(), message.pose().pose().position().y(),
         std::max(message.pose().covariance()[0], message.pose().covariance()[7]));
  for (geometry_msgs::msg::dds_::PoseStamped_ message; pose_ && pose_->take(message);)
    note(message.header(), message.pose().position().x(), message.pose().position().y(), 0);
  for (sensor_msgs::msg::dds_::NavSatFix_ message; fix_ && fix_->take(message);)
    note(message.header(), message.latitude(), message.longitude(),
         std::max(message.position_covariance()[0], message.position_covariance()[4]),
         static_cast<std::int8_t>(message.status().status()) >= 0);  // STATUS_NO_FIX is -1
}

std::string PositionTopic::why_silent() const {
  if (odometry_) return odometry_->why_silent(topic_);
  return pose_ ? pose_->why_silent(topic_) : fix_->why_silent(topic_);
}

}  // namespace citylearn
