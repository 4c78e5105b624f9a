// SPDX-License-Identifier: Apache-2.0
#include "env_service/live/robot_senses.h"

#include <spdlog/spdlog.h>

#include "core/files/image_header.h"
#include "core/ros2/header.h"
#include "core/util/error.h"
#include "env_service/images/raw_image.h"

namespace citylearn {
namespace {

constexpr std::uint64_t kLatest = 5 * kRos2Second;  // what is older than that has another clock

RobotTopics named(const RobotTopics& topics) {
  RobotTopics result = topics;
  if (topics.camera.empty())
    throw Error("the camera's topic is missing", "--camera", "as /camera/image_raw/compressed");
  result.camera = ros2_topic(topics.camera, "--camera");
  if (!topics.position.empty()) result.position = ros2_topic(topics.position, "--position");
  return result;
}

}  // namespace

RobotSenses::RobotSenses(Ros2Participant& ros, const RobotTopics& topics) : topics_(named(topics)) {
  if (topics_.camera.ends_with("/compressed"))
    compressed_ = ros.subscribe<Compressed>(topics_.camera);
  else
    raw_ = ros.subscribe<Raw>(topics_.camera);
  if (!topics_.position.empty()) position_topic_.emplace(ros, topics_.position, topics_.source, Profile::kRos2);
}

void RobotSenses::poll() {
  while (compressed_ && compressed_->take(compressed_message_)) take(compressed_message_);
  while (raw_ && raw_->take(raw_message_)) take(raw_message_);
  if (!position_topic_) return;
  if (const auto position = position_topic_->take()) position_ = position;
}

bool RobotSenses::follows(std::uint64_t stamp, std::uint64_t before) {
  return stamp > before || before - stamp > kLatest;
}

/// Returns whether a picture comes after the newest one, and counts those that do not.
bool RobotSenses::is_next(std::uint64_t stamp) {
  if (!picture_) return true;
  if (follows(stamp, picture_->stamp)) {
    if (stamp < picture_->stamp)
      spdlog::warn("the camera's clock was set back by {} s", (picture_->stamp - stamp) / kRos2Second);
    return true;
  }
  ++(stamp == picture_->stamp ? counts_.repeated : counts_.late);
  return false;
}

void RobotSenses::take(const Compressed& image) {
  const std::uint64_t stamp = stamp_of(image.header());
  if (!is_next(stamp)) return;
  const std::span<const std::byte> file = std::as_bytes(std::span(image.data()));
  if (file.size() > kMaxImageBytes) return note_broken("has " + std::to_string(file.size()) + " bytes");
  if (const auto fault = image_fault(file)) return note_broken(*fault);
  picture_ = Picture{stamp, Bytes(file.begin(), file.end())};
  ++counts_.pictures;
}

void RobotSenses::take(const Raw& image) {
  const std::uint64_t stamp = stamp_of(image.header());
  if (!is_next(stamp)) return;
  Picture picture{stamp, {}};
  const std::string fault =
      encode_raw({image.width(), image.height(), image.step(), image.encoding(), image.data()}, picture.file);
  if (!fault.empty()) return note_broken(fault);
  picture_ = std::move(picture);
  ++counts_.pictures;
}

void RobotSenses::note_broken(const std::string& why) {
  if (++counts_.broken == 1) spdlog::warn("a picture on {}: {} (more are counted, not logged)", topics_.camera, why);
  fault_ = why;
}

std::string RobotSenses::why_no_picture() const {
  if (!picture_ && !fault_.empty()) return "pictures on " + topics_.camera + " are broken: " + fault_;
  return compressed_ ? compressed_->why_silent(topics_.camera) : raw_->why_silent(topics_.camera);
}

std::string RobotSenses::why_no_position() const { return position_topic_ ? position_topic_->why_silent() : ""; }

}  // namespace citylearn
