// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>

#include "core/recording/mcap_writer.h"
#include "core/ros2/messages.h"
#include "core/util/version.h"

namespace citylearn {

/// Writes an MCAP file of profile ros2, which rosbag2, Foxglove, Lichtblick and Rerun open.
class Ros2BagWriter : public McapWriter {
 public:
  explicit Ros2BagWriter(const std::string& path)
      : McapWriter(path, {.library = "citylearn " + version(), .about = {}, .profile = "ros2"}) {}
  /// Adds a channel and returns its number. rosbag2 asks for the qualities of each; none given are its default.
  std::uint16_t add(McapChannel channel) {
    channel.metadata["offered_qos_profiles"] = "";
    return McapWriter::add(std::move(channel));
  }
  std::uint16_t add(const std::string& topic, const Ros2Type& type) {
    return add({topic, type.name, "ros2msg", type.schema, "cdr", {{"topic_type_hash", type.hash}}});
  }
};

}  // namespace citylearn
