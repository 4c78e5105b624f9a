// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <string>
#include <vector>

namespace citylearn {

/// The state of a training when one of its updates was recorded.
struct RecordedUpdate {
  double position = 0;  ///< from which it is shown: seconds, as in ReplayState
  std::uint64_t update = 0, steps = 0, episodes = 0;
  double wall = 0;  ///< seconds of training
};

/// A training run of a recording.
struct RecordedRun {
  std::string session, policy;  ///< as headers name its policy_service
  std::uint64_t seed = 0, run_id = 0;
  /// The updates in the order of the recording, each once: one that was sent again is left out, and so are all but the
  /// newest of those before the first RunInfo. Where a policy_service resumed from an older checkpoint, the same
  /// updates follow once more.
  std::vector<RecordedUpdate> updates;
};

/// Figures for a timeline of recordings that are played one after the other.
struct RecordingOutline {
  static constexpr std::size_t kParts = 100;  ///< equally long ones, in which messages are counted
  double seconds = 0;                         ///< their length, as RecordingClock measures it
  std::array<std::uint64_t, kParts> updates{}, episodes{};
  std::vector<RecordedRun> runs;  ///< those with a RunInfo and an update
};

/// Reads the files once. A damaged file counts up to where it is damaged; playing it reports the damage. Returns early,
/// with what was read so far, when `stop` is requested.
RecordingOutline outline_of(const std::vector<std::string>& files, const std::stop_token& stop);

}  // namespace citylearn
