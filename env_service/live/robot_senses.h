// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "core/ros2/participant.h"
#include "env_service/live/position_topic.h"
#include "env_service/live/robot_options.h"
#include "ros2/ros2.h"

namespace citylearn {

/// Hears a robot: what its camera takes and where it is. A picture that comes twice, or after a later one, is counted
/// and not used. Used by the participant's thread.
class RobotSenses {
 public:
  struct Picture {
    std::uint64_t stamp = 0;  ///< as stamp_of()
    Bytes file;               ///< JPEG, PNG, PNM or BMP
  };
  struct Counts {
    std::uint64_t pictures = 0;  ///< used
    std::uint64_t repeated = 0, late = 0, broken = 0;
  };

  /// `ros` must outlive it. Throws Error when a topic is not one.
  RobotSenses(Ros2Participant& ros, const RobotTopics& topics);

  /// Takes what has come.
  void poll();
  /// Returns whether what has this stamp was taken after what has the other one. One that is several seconds older is
  /// of a robot whose clock was set back.
  static bool follows(std::uint64_t stamp, std::uint64_t before);
  /// The newest of each; empty: none came yet.
  const std::optional<Picture>& picture() const { return picture_; }
  const std::optional<PositionTopic::Position>& position() const { return position_; }
  const Counts& counts() const { return counts_; }
  /// Says why nothing comes from the camera, or from the position: "nobody publishes sensor_msgs/msg/Image on
  /// /camera/image_raw".
  std::string why_no_picture() const;
  std::string why_no_position() const;

 private:
  using Compressed = sensor_msgs::msg::dds_::CompressedImage_;
  using Raw = sensor_msgs::msg::dds_::Image_;

  bool is_next(std::uint64_t stamp);
  void take(const Compressed& image);
  void take(const Raw& image);
  void note_broken(const std::string& why);

  const RobotTopics topics_;
  std::optional<Ros2Subscription<Compressed>> compressed_;
  std::optional<Ros2Subscription<Raw>> raw_;
  std::optional<PositionTopic> position_topic_;
  std::optional<Picture> picture_;
  std::optional<PositionTopic::Position> position_;
  Counts counts_;
  std::string fault_;  // of the last broken picture
  Compressed compressed_message_;
  Raw raw_message_;
};

}  // namespace citylearn
