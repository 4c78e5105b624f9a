// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string>

#include "core/util/types.h"

namespace citylearn {

/// A type of ROS 2's common_interfaces (msg/, srv/).
struct Ros2Type {
  std::string name;    ///< "sensor_msgs/msg/CompressedImage"
  std::string dds;     ///< its name on DDS: "sensor_msgs::msg::dds_::CompressedImage_"
  std::string hash;    ///< of its definition, as ROS 2 compares it from Iron on: "RIHS01_" and 64 hexadecimal digits
  std::string schema;  ///< its definition with all that it includes, as MCAP's ros2msg
  std::string service_hash;  ///< of a request or a response: that of its service; else empty
};

/// A message of ROS 2.
struct Ros2Message {
  std::string topic;  ///< "/citylearn/env_summer/agent_0/pose"
  const Ros2Type* type = nullptr;
  std::uint64_t time = 0;           ///< nanoseconds since 1970
  std::span<const std::byte> data;  ///< CDR, 4 bytes of encapsulation first
};

/// Takes messages. Used by one thread.
class Ros2Sink {
 public:
  virtual ~Ros2Sink() = default;
  /// Throws Error when it cannot write.
  virtual void publish(const Ros2Message& message) = 0;
};

/// Returns the type of `Message`, one of those that are generated from msg/ and srv/; others do not link.
template <class Message>
const Ros2Type& ros2_type_of();

/// Returns the type of this name, "sensor_msgs/msg/Image"; null for all others.
const Ros2Type* ros2_type(const std::string& name);

/// Writes the CDR bytes of a message into `bytes` (its capacity is used again).
template <class Message>
void encode_ros2(const Message& message, Bytes& bytes);

/// Reads a message from its CDR bytes, 4 bytes of encapsulation first, in either byte order. Returns false when they
/// are something else; it then holds anything. Allocates no more than the bytes are.
template <class Message>
bool decode_ros2(std::span<const std::byte> bytes, Message& message);

}  // namespace citylearn
