// SPDX-License-Identifier: Apache-2.0
#include "tools/ros2/sinks.h"

#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kFlushInterval = 1'000'000'000;  // nanoseconds

}  // namespace

Ros2File::Ros2File(const std::string& path, const std::string& library)
    : writer_(path, [&] {
        McapWriter::Options options;
        options.library = library;
        options.profile = "ros2";
        return options;
      }()) {}

void Ros2File::publish(const Ros2Message& message) {
  std::uint16_t& channel = channels_[message.topic];
  // rosbag2 asks for the qualities; none given are its default.
  if (channel == 0)
    channel = writer_.add(
        {message.topic, message.type->name, "ros2msg", message.type->schema, "cdr", {{"offered_qos_profiles", ""}}});
  writer_.write(channel, message.time, message.data);
  ++counts_[message.topic];
}

void Ros2File::poll() {
  if (const std::uint64_t since = writer_.waiting_since();
      since != 0 && nanoseconds_since_epoch() - since >= kFlushInterval)
    writer_.flush();
}

}  // namespace citylearn
