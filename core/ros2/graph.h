// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <string>
#include <vector>

#include "core/dds/middleware.h"

namespace citylearn {

/// What a participant publishes on `ros_discovery_info` to be a node of ROS 2: rmw_dds_common's
/// ParticipantEntitiesInfo, of one node.
struct Ros2Node {
  Guid participant{};
  std::string name_space, name;  ///< "/citylearn", "ros2_bridge"
  std::vector<Guid> readers, writers;
};

/// Returns the releases of ROS 2 that ros2_gid_bytes() knows.
const std::vector<std::string>& ros2_distros();

/// Returns the bytes of a gid in a release's messages: 24 up to Humble, of which the last 8 are zero, then 16. A reader
/// of the other size takes the message for one without nodes.
std::size_t ros2_gid_bytes(const std::string& distro);

/// Returns the CDR bytes of the message.
Bytes encode_ros2(const Ros2Node& node, std::size_t gid_bytes);

/// Returns whether the bytes are such a message, of any number of nodes, with gids of this size.
bool has_gids_of(std::size_t gid_bytes, std::span<const std::byte> message);

}  // namespace citylearn
