// SPDX-License-Identifier: Apache-2.0
#include "env_service/ros2/sensor_messages.h"

#include <algorithm>
#include <cmath>

#include "core/files/image_header.h"
#include "core/ros2/header.h"
#include "core/util/text.h"
#include "env_service/images/raw_image.h"

namespace citylearn {
namespace {

constexpr double kNullIsland = 1e-3;  // degrees around 0,0
constexpr double kMaxMetres = 1e8;    // from the origin of a frame
constexpr double kMaxVariance = 100;  // square metres

RawImage raw_image(const sensor_msgs::msg::dds_::Image_& image) {
  return {image.width(), image.height(), image.step(), image.encoding(), image.data(), image.is_bigendian() != 0};
}

/// Returns why this is not a position; empty when it is one.
std::string fault_of(double x, double y, bool degrees) {
  if (!std::isfinite(x) || !std::isfinite(y)) return "is NaN or infinite";
  if (!degrees) return std::hypot(x, y) > kMaxMetres ? "is over 100,000 km from the origin" : "";
  if (std::abs(x) > 90 || std::abs(y) > 180) return "is beyond latitude 90 or longitude 180";
  return std::hypot(x, y) < kNullIsland ? kAtNullIsland : "";
}

/// Returns the greater of two variances; 0 where senders do not know them: they then give zeros, -1 or NaN.
double known_variance(double x, double y) { return x >= 0 && y >= 0 ? std::max(x, y) : 0; }

SensedPosition checked(const std_msgs::msg::dds_::Header_& header, double x, double y, double variance, bool degrees) {
  SensedPosition position{ros2_time(header), x, y, variance};
  position.fault = fault_of(x, y, degrees);
  if (!degrees) position.frame = one_line(header.frame_id().substr(header.frame_id().starts_with("/") ? 1 : 0, 40));
  if (variance > kMaxVariance) position.doubt = "may be 10 m off or more, by its covariance";
  return position;
}

/// Returns the position of an Odometry or a PoseWithCovarianceStamped.
template <class Message>
SensedPosition with_covariance(const Message& message) {
  const auto& position = message.pose().pose().position();
  const auto& covariance = message.pose().covariance();
  return checked(message.header(), position.x(), position.y(), known_variance(covariance[0], covariance[7]), false);
}

}  // namespace

std::string picture_fault(const sensor_msgs::msg::dds_::Image_& image) { return raw_fault(raw_image(image)); }

std::string picture_fault(const sensor_msgs::msg::dds_::CompressedImage_& image) {
  std::string fault = image_fault(std::as_bytes(std::span(image.data()))).value_or("");
  if (image.data().size() > kMaxImageBytes) fault = std::to_string(image.data().size()) + " bytes";
  return fault.empty() ? "" : "has format '" + one_line(image.format().substr(0, 40)) + "': " + fault;
}

std::string read_picture(const sensor_msgs::msg::dds_::Image_& image, Bytes& file) {
  return encode_raw(raw_image(image), file);
}

std::string read_picture(const sensor_msgs::msg::dds_::CompressedImage_& image, Bytes& file) {
  const std::span<const std::byte> bytes = std::as_bytes(std::span(image.data()));
  file.assign(bytes.begin(), bytes.end());
  return picture_fault(image);
}

SensedPosition position_of(const nav_msgs::msg::dds_::Odometry_& message) { return with_covariance(message); }

SensedPosition position_of(const geometry_msgs::msg::dds_::PoseWithCovarianceStamped_& message) {
  return with_covariance(message);
}

SensedPosition position_of(const geometry_msgs::msg::dds_::PoseStamped_& message) {
  return checked(message.header(), message.pose().position().x(), message.pose().position().y(), 0, false);
}

SensedPosition position_of(const sensor_msgs::msg::dds_::NavSatFix_& message) {
  const auto& covariance = message.position_covariance();
  const bool told = message.position_covariance_type() != 0;  // COVARIANCE_TYPE_UNKNOWN
  SensedPosition position = checked(message.header(), message.latitude(), message.longitude(),
                                    told ? known_variance(covariance[0], covariance[4]) : 0, true);
  position.height = message.altitude();
  if (static_cast<std::int8_t>(message.status().status()) < 0) position.fault = "has no fix";  // STATUS_NO_FIX is -1
  return position;
}

}  // namespace citylearn
