// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/robot_senses.h"

#include <spdlog/fmt/fmt.h>
#include <spdlog/spdlog.h>

#include "core/ros2/header.h"
#include "core/util/error.h"
#include "core/util/text.h"
#include "env_service/ros2/sensor_messages.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kMaxStampAge = 5 * kRos2Second;  // what is older than that has another clock

RobotTopics named(const RobotTopics& topics) {
  RobotTopics result = topics;
  if (topics.camera.empty())
    throw Error("the camera's topic is missing", "--camera", "as /camera/image_raw/compressed");
  result.camera = ros2_topic(topics.camera, "--camera");
  if (!topics.position.empty()) result.position = ros2_topic(topics.position, "--position");
  return result;
}

constexpr const char* kNoStamp = "has no stamp: the time of its arrival counts";
constexpr const char* kSetBack = "is older than the one before: a clock was set back, or two cameras send";
constexpr std::size_t kMaxFaults = 8;  // of a topic: some hold what a sender wrote

/// Returns why a message is not used after another one; empty: it is.
std::string order_fault(std::uint64_t stamp, std::uint64_t before) {
  if (RobotSenses::follows(stamp, before)) return "";
  return stamp == before ? "came twice" : "came late";
}

}  // namespace

void MessageFaults::count(const std::string& fault, bool used) {
  ++came_;
  used_ += used;
  refused_ = !used;
  if (fault.empty()) return;
  const std::string& kind = counts_.size() < kMaxFaults || counts_.contains(fault) ? fault : "has other faults";
  if (++counts_[kind] == 1)
    spdlog::warn("{}: a message is {}used: it {} (more are counted, not logged)", topic_, used ? "" : "not ", kind);
}

std::string MessageFaults::text(bool counted) const {
  const auto one = [counted](const auto& each) {
    return each.first + (counted ? fmt::format(" ({} message{})", each.second, each.second == 1 ? "" : "s") : "");
  };
  return counts_.empty() ? "" : topic_ + " " + joined(counts_, one);
}

RobotSenses::RobotSenses(Ros2Participant& ros, const RobotTopics& topics)
    : clock_(ros.clock()), topics_(named(topics)), picture_faults_(topics_.camera), position_faults_(topics_.position) {
  if (topics_.camera.ends_with("/compressed"))
    compressed_ = ros.subscribe<Compressed>(topics_.camera);
  else
    raw_ = ros.subscribe<Raw>(topics_.camera);
  if (!topics_.position.empty()) position_topic_.emplace(ros, topics_.position, topics_.source, Profile::kRos2);
}

bool RobotSenses::poll() {
  const bool back = std::exchange(setbacks_, clock_.setbacks()) != clock_.setbacks();
  if (back) {
    picture_.reset();
    position_.reset();
  }
  while (compressed_ && compressed_->take(compressed_message_)) take_picture(compressed_message_);
  while (raw_ && raw_->take(raw_message_)) take_picture(raw_message_);
  if (position_topic_) position_topic_->take([this](const PositionTopic::Position& position) { take(position); });
  return back;
}

void RobotSenses::take(const PositionTopic::Position& position) {
  std::string fault = position.fault;
  if (fault.empty() && frame_.empty()) frame_ = position.frame;
  if (fault.empty() && !position.frame.empty() && position.frame != frame_)
    fault = "is in frame '" + position.frame + "', the first in '" + frame_ + "'";
  if (fault.empty() && position.variance > max_deviation_ * max_deviation_)
    fault = fmt::format("may be over {:.3g} m off, by its covariance", max_deviation_);
  if (fault.empty() && position_) fault = order_fault(position.stamp, position_->stamp);
  position_faults_.count(fault.empty() ? position.doubt : fault, fault.empty());
  if (fault.empty()) position_ = position;
}

template <class Image>
void RobotSenses::take_picture(const Image& image) {
  Picture picture{stamp_of(image.header(), clock_), {}};
  std::string fault = picture_ ? order_fault(picture.stamp, picture_->stamp) : "";
  if (fault.empty()) fault = read_picture(image, picture.file);
  const bool back = picture_ && picture.stamp < picture_->stamp;
  const std::string doubt = ros2_time(image.header()) == 0 ? kNoStamp : back ? kSetBack : "";
  picture_faults_.count(fault.empty() ? doubt : fault, fault.empty());
  if (fault.empty()) picture_ = std::move(picture);
}

bool RobotSenses::follows(std::uint64_t stamp, std::uint64_t before) {
  return stamp > before || before - stamp > kMaxStampAge;
}

std::string RobotSenses::why_no_picture(bool counted) const {
  if (picture_faults_.refused()) return picture_faults_.text(counted);
  return compressed_ ? compressed_->why_silent(topics_.camera) : raw_->why_silent(topics_.camera);
}

std::string RobotSenses::why_no_position(bool counted) const {
  if (position_faults_.refused()) return position_faults_.text(counted);
  return position_topic_ ? position_topic_->why_silent() : "";
}

}  // namespace citylearn
