// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "ros2/ros2.h"

namespace citylearn {

inline constexpr std::uint64_t kRos2Second = 1'000'000'000;  ///< nanoseconds

/// Returns the header of a message of that time, nanoseconds since 1970.
inline std_msgs::msg::dds_::Header_ ros2_header(const std::string& frame_id, std::uint64_t time) {
  std_msgs::msg::dds_::Header_ header;
  header.stamp().sec(static_cast<std::int32_t>(time / kRos2Second));
  header.stamp().nanosec(static_cast<std::uint32_t>(time % kRos2Second));
  header.frame_id(frame_id);
  return header;
}

/// Returns a time in nanoseconds since 1970; 0 where it is before that.
inline std::uint64_t ros2_time(const builtin_interfaces::msg::dds_::Time_& time) {
  const std::int64_t seconds = time.sec();
  return seconds < 0 ? 0 : static_cast<std::uint64_t>(seconds) * kRos2Second + time.nanosec();
}

/// Returns a header's time likewise; 0 where it has none.
inline std::uint64_t ros2_time(const std_msgs::msg::dds_::Header_& header) { return ros2_time(header.stamp()); }

}  // namespace citylearn
