// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "core/recording/mcap_writer.h"
#include "core/ros2/messages.h"

namespace citylearn {

/// Writes an MCAP file of profile ros2, which rosbag2, Foxglove, Lichtblick and Rerun open.
class Ros2File : public Ros2Sink {
 public:
  /// Throws Error naming the file when it is there already or cannot be made.
  Ros2File(const std::string& path, const std::string& library);
  void publish(const Ros2Message& message) override;
  /// Writes what has waited for a second.
  void poll();
  /// Writes all that is left, and the summary.
  void close() { writer_.close(); }

  std::uint64_t bytes() const { return writer_.bytes(); }
  const std::map<std::string, std::uint64_t>& counts() const { return counts_; }  ///< messages by topic

 private:
  McapWriter writer_;
  std::map<std::string, std::uint16_t> channels_;  // by topic
  std::map<std::string, std::uint64_t> counts_;
};

}  // namespace citylearn
