// SPDX-License-Identifier: Apache-2.0
#include "core/ros2/clock.h"

#include <spdlog/spdlog.h>

#include <utility>

#include "core/ros2/header.h"
#include "core/util/wall_clock.h"

namespace citylearn {
namespace {

constexpr std::chrono::seconds kMaxSilence{5};

}  // namespace

void Ros2Clock::follow(Topic topic) {
  topic_ = std::move(topic);
  at_ = last_alive_ = Clock::now();
}

std::uint64_t Ros2Clock::time() const { return simulated() ? time_ : nanoseconds_since_epoch(); }

void Ros2Clock::poll(Clock::time_point now) {
  if (!simulated()) return;
  for (rosgraph_msgs::msg::dds_::Clock_ message; topic_->take(message);) set(ros2_time(message.clock()));
  if (heard_ && topic_->publishers() > 0) {  // one that is paused publishes nothing
    last_alive_ = now;
    trouble_.clear();
  } else if (trouble_.empty() && now - last_alive_ > kMaxSilence) {
    trouble_ = topic_->why_silent("/clock");
    spdlog::warn(
        "--use-sim-time: {}: time stands still until a simulator (with ros_gz_bridge) or 'ros2 bag play --clock' does",
        trouble_);
  }
}

void Ros2Clock::set(std::uint64_t time) {
  const std::uint64_t before = std::exchange(time_, time);
  if (!std::exchange(heard_, true)) return;
  if (time >= before) {
    at_ += std::chrono::nanoseconds(time - before);
  } else if (++setbacks_ == 1) {
    spdlog::warn(
        "/clock was set back by {:.1f} s, and ages begin anew: a simulator was reset, a bag is played again, or two "
        "nodes publish it (more are not logged)",
        1e-9 * static_cast<double>(before - time));
  }
}

}  // namespace citylearn
