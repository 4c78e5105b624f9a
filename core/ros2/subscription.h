// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <utility>

#include "core/dds/middleware.h"
#include "core/ros2/messages.h"

namespace citylearn {

/// Hears one topic. Used by the participant's thread, and not after it.
template <class Message>
class Ros2Subscription {
 public:
  explicit Ros2Subscription(std::unique_ptr<Subscription> subscription) : subscription_(std::move(subscription)) {}

  /// Takes the next message that can be read; false when there is none.
  bool take(Message& message) {
    while (subscription_->take(bytes_)) {
      if (decode_ros2(bytes_, message)) return true;
      ++unreadable_;
    }
    return false;
  }
  int publishers() const { return subscription_->matched(); }
  /// Says why nothing comes: "nobody publishes sensor_msgs/msg/Image on /camera/image_raw".
  std::string why_silent(const std::string& topic) const {
    if (publishers() == 0) return "nobody publishes " + ros2_type_of<Message>().name + " on " + topic;
    if (unreadable_ > 0) return "what comes on " + topic + " is of another type";
    return "nothing comes on " + topic;
  }

 private:
  std::unique_ptr<Subscription> subscription_;
  Bytes bytes_;
  std::uint64_t unreadable_ = 0;
};

}  // namespace citylearn
