// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "ros2/ros2.h"

namespace citylearn::testing {

/// Returns a message of /clock, of that many seconds.
inline rosgraph_msgs::msg::dds_::Clock_ ros2_clock(double time) {
  rosgraph_msgs::msg::dds_::Clock_ message;
  message.clock().sec(static_cast<std::int32_t>(time));
  message.clock().nanosec(static_cast<std::uint32_t>(1e9 * (time - static_cast<std::int32_t>(time))));
  return message;
}

}  // namespace citylearn::testing
