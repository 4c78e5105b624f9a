// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>

#include "core/files/growing_file.h"
#include "env_service/live/robot_senses.h"

namespace citylearn {

struct TeachOptions {
  RobotTopics topics;
  std::string folder;     ///< DIR: the traversal becomes DIR/NAME/ and DIR/NAME.poses.csv, of dataset plain
  std::string traversal;  ///< NAME
  double spacing = 2;     ///< metres between frames; without positions: not used
  double interval = 1;    ///< seconds between frames, without positions
};

/// Records what a robot's camera sees along a route as a traversal: a frame wherever it has come `spacing` metres
/// further, with the place. Every frame that is counted is on the disk. Used by the participant's thread.
class Teacher {
 public:
  /// `ros` must outlive it. Throws Error when the traversal is there already or cannot be written.
  Teacher(const TeachOptions& options, Ros2Participant& ros);
  /// Without a frame nothing is left of the traversal.
  ~Teacher();
  Teacher(const Teacher&) = delete;
  Teacher& operator=(const Teacher&) = delete;

  /// Takes what has come. Throws Error when the disk is full.
  void poll();
  int frames() const { return frames_; }
  /// Says which topic has been silent for three seconds, and why; empty: none has.
  std::string trouble(Clock::time_point now) const;
  const RobotSenses& senses() const { return senses_; }

 private:
  bool is_next() const;
  void write_frame();

  const TeachOptions options_;
  RobotSenses senses_;
  const std::string pictures_, poses_path_;
  std::unique_ptr<GrowingFile> poses_;  // null: there was no frame yet, or there are no positions
  int frames_ = 0;
  std::uint64_t pictures_taken_ = 0, position_taken_ = 0;  // how many, and the stamp of the last
  Clock::time_point picture_came_ = Clock::now(), position_came_ = picture_came_;
  std::uint64_t picture_ = 0;                        // stamp of the last frame
  std::optional<PositionTopic::Position> position_;  // of the last frame
};

}  // namespace citylearn
