// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/files/growing_file.h"
#include "env_service/live/robot_senses.h"

namespace citylearn {

struct TeachOptions {
  RobotTopics topics;
  std::string folder;     ///< DIR: the traversal becomes DIR/NAME/ and DIR/NAME.poses.csv, of dataset plain
  std::string traversal;  ///< NAME
  double spacing = 2;     ///< metres between frames; without positions: not used
  double interval = 1;    ///< seconds between frames, without positions
  bool paused = false;    ///< it records only once the service ~/record says so
};

/// Records what a robot's camera sees along a route as a traversal: a frame wherever it has come `spacing` metres
/// further, with the place. Nodes pause it and let it go on by the service ~/record (std_srvs/SetBool). Every frame
/// that is counted is on the disk. Used by the participant's thread.
class Teacher {
 public:
  /// `ros` must outlive it. Throws Error when the traversal is there already or cannot be written.
  Teacher(const TeachOptions& options, Ros2Participant& ros);
  /// Without a frame nothing is left of the traversal.
  ~Teacher();
  Teacher(const Teacher&) = delete;
  Teacher& operator=(const Teacher&) = delete;

  /// Takes what has come by that time of the steady clock. Throws Error when the disk is full.
  void poll(Clock::time_point steady = Clock::now());
  int frames() const { return frames_; }
  /// Says which topic has been silent for three seconds by the robot's clock, and why; empty: none has.
  std::string trouble(Clock::time_point steady) const;
  const RobotSenses& senses() const { return senses_; }
  /// Says what came and was not used, and where frames are missing, a line each: "4 s without a position: 9.8 m without
  /// frames before 000004.png". Frames are missing where two are more than twice as far apart as was asked.
  std::vector<std::string> shortcomings() const;
  /// Says why there are fewer than the two frames that a route needs.
  std::string why_no_route() const;

 private:
  /// The times at which a topic was heard.
  struct Topic {
    std::uint64_t stamp = 0;  // of the newest message, and when it came
    Clock::time_point came;
    Clock::duration interval{}, silence{};  // between the last two messages; the longest one since the last frame
    void hear(std::uint64_t newest, Clock::time_point now);
    bool silent(Clock::time_point now) const;
  };

  using SetBoolRequest = std_srvs::srv::dds_::SetBool_Request_;
  using SetBoolResponse = std_srvs::srv::dds_::SetBool_Response_;

  bool is_next(Clock::time_point now) const;
  void write_frame(Clock::time_point now);
  void note_hole(const std::string& file, Clock::time_point now);
  SetBoolResponse set_recording(const SetBoolRequest* request, Clock::time_point steady);
  double metres_to(const PositionTopic::Position& position) const {
    return position_ ? PositionTopic::metres_between(options_.topics.source, *position_, position) : 0;
  }

  const TeachOptions options_;
  const Ros2Participant& ros_;
  RobotSenses senses_;
  Ros2Service<SetBoolRequest, SetBoolResponse> record_;
  bool paused_, was_paused_ = false;  // was_paused_: since the last frame
  const std::string pictures_, poses_path_;
  std::unique_ptr<GrowingFile> poses_;  // null: there was no frame yet, or there are no positions
  int frames_ = 0;
  Topic pictures_heard_, positions_heard_;
  Clock::time_point frame_came_;
  std::uint64_t picture_ = 0;                        // stamp of the last frame
  std::optional<PositionTopic::Position> position_;  // of the last frame
  std::string file_;                                 // of the last frame
  int holes_ = 0;
  double longest_ = 0;                     // of the holes, metres, or seconds without positions
  std::string longest_hole_, first_hole_;  // first_hole_: before the first frame
};

}  // namespace citylearn
