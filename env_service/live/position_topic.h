// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "core/ros2/participant.h"
#include "env_service/live/robot_options.h"
#include "env_service/ros2/sensor_messages.h"

namespace citylearn {

/// Returns when a message was made, nanoseconds by its sender's clock; where it does not say, what `clock` says.
std::uint64_t stamp_of(const std_msgs::msg::dds_::Header_& header, const Ros2Clock& clock);

/// Hears positions on one topic: where a robot is, or where it is sent. Used by the participant's thread.
class PositionTopic {
 public:
  using Position = SensedPosition;  ///< stamp: as stamp_of()
  /// Returns the metres between two positions of one source.
  static double metres_between(PositionSource source, const Position& a, const Position& b);

  /// `ros` must outlive it. `profile`: kRos2, or kRos2Reliable where each message counts.
  PositionTopic(Ros2Participant& ros, std::string topic, PositionSource source, Profile profile);

  /// Takes what has come, each message in turn, those with a fault too.
  void take(const std::function<void(const Position&)>& use);
  /// Says why nothing comes, as Ros2Subscription::why_silent().
  std::string why_silent() const;
  const std::string& name() const { return topic_; }

 private:
  const Ros2Clock& clock_;
  const std::string topic_;
  std::optional<Ros2Subscription<nav_msgs::msg::dds_::Odometry_>> odometry_;
  std::optional<Ros2Subscription<geometry_msgs::msg::dds_::PoseStamped_>> pose_;
  std::optional<Ros2Subscription<geometry_msgs::msg::dds_::PoseWithCovarianceStamped_>> covariant_;
  std::optional<Ros2Subscription<sensor_msgs::msg::dds_::NavSatFix_>> fix_;
};

}  // namespace citylearn
