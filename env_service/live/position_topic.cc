// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/position_topic.h"

#include <cmath>
#include <utility>

#include "core/ros2/header.h"
#include "env_service/geometry/geometry.h"

namespace citylearn {

std::uint64_t stamp_of(const std_msgs::msg::dds_::Header_& header, const Ros2Clock& clock) {
  const std::uint64_t stamp = ros2_time(header);
  return stamp > 0 ? stamp : clock.time();
}

double PositionTopic::metres_between(PositionSource source, const Position& a, const Position& b) {
  return source == PositionSource::kFix ? citylearn::metres_between(a.x, a.y, b.x, b.y)
                                        : std::hypot(a.x - b.x, a.y - b.y);
}

PositionTopic::PositionTopic(Ros2Participant& ros, std::string topic, PositionSource source, Profile profile)
    : clock_(ros.clock()), topic_(std::move(topic)) {
  switch (source) {
    case PositionSource::kOdometry:
      odometry_ = ros.subscribe<nav_msgs::msg::dds_::Odometry_>(topic_, profile);
      break;
    case PositionSource::kPose:
      pose_ = ros.subscribe<geometry_msgs::msg::dds_::PoseStamped_>(topic_, profile);
      break;
    case PositionSource::kPoseWithCovariance:
      covariant_ = ros.subscribe<geometry_msgs::msg::dds_::PoseWithCovarianceStamped_>(topic_, profile);
      break;
    case PositionSource::kFix:
      fix_ = ros.subscribe<sensor_msgs::msg::dds_::NavSatFix_>(topic_, profile);
      break;
  }
}

void PositionTopic::take(const std::function<void(const Position&)>& use) {
  const auto note = [&](const auto& message) {
    Position position = position_of(message);
    if (position.stamp == 0 && position.doubt.empty()) position.doubt = "has no stamp: the time of its arrival counts";
    position.stamp = stamp_of(message.header(), clock_);
    use(position);
  };
  for (nav_msgs::msg::dds_::Odometry_ message; odometry_ && odometry_->take(message);) note(message);
  for (geometry_msgs::msg::dds_::PoseStamped_ message; pose_ && pose_->take(message);) note(message);
  for (geometry_msgs::msg::dds_::PoseWithCovarianceStamped_ message; covariant_ && covariant_->take(message);)
    note(message);
  for (sensor_msgs::msg::dds_::NavSatFix_ message; fix_ && fix_->take(message);) note(message);
}

std::string PositionTopic::why_silent() const {
  if (odometry_) return odometry_->why_silent(topic_);
  if (covariant_) return covariant_->why_silent(topic_);
  return pose_ ? pose_->why_silent(topic_) : fix_->why_silent(topic_);
}

}  // namespace citylearn
