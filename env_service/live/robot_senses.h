// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>

#include "core/ros2/participant.h"
#include "env_service/live/position_topic.h"
#include "env_service/live/robot_options.h"
#include "ros2/ros2.h"

namespace citylearn {

/// Times the distance between places: what is farther away is not on the route, and what may be farther off by its
/// covariance is not a position.
inline constexpr double kMaxPlacesAway = 10;

/// Counts what is wrong with the messages of a topic, and logs each fault when it comes first.
class MessageFaults {
 public:
  explicit MessageFaults(std::string topic) : topic_(std::move(topic)) {}

  /// Counts a message: it "has no fix" and is `used` or not. Empty: nothing is wrong with it.
  void count(const std::string& fault, bool used);
  bool refused() const { return refused_; }     ///< The last message was not used.
  std::uint64_t came() const { return came_; }  ///< messages
  std::uint64_t used() const { return used_; }
  /// Returns all faults as "/fix has no fix (110 messages)", or without how many; empty when there were none.
  std::string text(bool counted = true) const;

 private:
  const std::string topic_;
  std::map<std::string, std::uint64_t> counts_;
  std::uint64_t came_ = 0, used_ = 0;
  bool refused_ = false;
};

/// Hears a robot: what its camera takes and where it is. What comes twice, or after a later one, or has another fault
/// is counted and not used. Used by the participant's thread.
class RobotSenses {
 public:
  struct Picture {
    std::uint64_t stamp = 0;  ///< as stamp_of()
    Bytes file;               ///< JPEG, PNG, PNM or BMP
  };

  /// `ros` must outlive it. Throws Error when a topic is not one.
  RobotSenses(Ros2Participant& ros, const RobotTopics& topics);

  /// Lets positions whose standard deviation is greater be refused.
  void limit_deviation(double metres) { max_deviation_ = metres; }
  /// Takes what has come. Returns whether the time was set back: what came before is forgotten.
  bool poll();
  /// Returns whether what has this stamp was taken after what has the other one. One that is several seconds older is
  /// of a robot whose clock was set back.
  static bool follows(std::uint64_t stamp, std::uint64_t before);
  /// Return the newest of each, or nothing while none came.
  const std::optional<Picture>& picture() const { return picture_; }
  const std::optional<PositionTopic::Position>& position() const { return position_; }
  /// Returns how many publishers the camera's topic has.
  int cameras() const { return compressed_ ? compressed_->publishers() : raw_->publishers(); }
  /// Returns the frame in which positions are, "map"; empty: not known.
  const std::string& frame() const { return frame_; }
  const MessageFaults& picture_faults() const { return picture_faults_; }
  const MessageFaults& position_faults() const { return position_faults_; }
  /// Says why nothing that can be used comes from the camera, or from the position: "nobody publishes
  /// sensor_msgs/msg/Image on /camera/image_raw", "/fix has no fix (110 messages)", `counted` or not.
  std::string why_no_picture(bool counted) const;
  std::string why_no_position(bool counted) const;

 private:
  using Compressed = sensor_msgs::msg::dds_::CompressedImage_;
  using Raw = sensor_msgs::msg::dds_::Image_;

  void take(const PositionTopic::Position& position);
  template <class Image>
  void take_picture(const Image& image);

  const Ros2Clock& clock_;
  int setbacks_ = 0;  // of it
  const RobotTopics topics_;
  std::optional<Ros2Subscription<Compressed>> compressed_;
  std::optional<Ros2Subscription<Raw>> raw_;
  std::optional<PositionTopic> position_topic_;
  std::optional<Picture> picture_;
  std::optional<PositionTopic::Position> position_;
  MessageFaults picture_faults_, position_faults_;
  std::string frame_;                                               // of positions
  double max_deviation_ = std::numeric_limits<double>::infinity();  // metres
  Compressed compressed_message_;
  Raw raw_message_;
};

}  // namespace citylearn
