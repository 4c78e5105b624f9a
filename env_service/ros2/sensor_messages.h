// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <limits>
#include <string>

#include "core/util/types.h"
#include "ros2/ros2.h"

namespace citylearn {

// What messages of a robot's sensors say, be they heard or recorded.

/// Returns what is wrong with a picture, without decoding it, as "has 0 x 0 pixels of rgb8"; empty when nothing is.
std::string picture_fault(const sensor_msgs::msg::dds_::Image_& image);
std::string picture_fault(const sensor_msgs::msg::dds_::CompressedImage_& image);
/// Makes an image file of a picture: JPEG, PNG, PNM or BMP. Returns likewise what is wrong with it.
std::string read_picture(const sensor_msgs::msg::dds_::Image_& image, Bytes& file);
std::string read_picture(const sensor_msgs::msg::dds_::CompressedImage_& image, Bytes& file);

/// The fault of a NavSatFix near latitude and longitude 0, where simulators drive too.
inline const std::string kAtNullIsland = "is at 0,0, where receivers without a fix are";

/// Where a robot is, or where it is sent.
struct SensedPosition {
  std::uint64_t stamp = 0;  ///< nanoseconds by the sender's clock; 0: not told
  double x = 0, y = 0;      ///< metres, or degrees: latitude and longitude
  double variance = 0;      ///< of the worse of both, square metres; 0: not known
  std::string frame = {};   ///< in which metres are, as "map"; may be empty
  std::string fault = {};   ///< why it is not a position: it "has no fix"; empty: it is one
  std::string doubt = {};   ///< what else is wrong with it: it "has no stamp"
  double height = std::numeric_limits<double>::quiet_NaN();  ///< metres, of a fix
};
SensedPosition position_of(const nav_msgs::msg::dds_::Odometry_& message);
SensedPosition position_of(const geometry_msgs::msg::dds_::PoseStamped_& message);
SensedPosition position_of(const geometry_msgs::msg::dds_::PoseWithCovarianceStamped_& message);
SensedPosition position_of(const sensor_msgs::msg::dds_::NavSatFix_& message);

}  // namespace citylearn
