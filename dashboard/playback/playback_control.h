// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "core/recording/outline.h"
#include "core/recording/replay_clock.h"

namespace citylearn {

/// Changes of a playback that a request asks for. Absent fields change nothing.
struct PlaybackChange {
  std::optional<bool> paused;
  std::optional<double> speed;     ///< as in ReplayState
  std::optional<double> position;  ///< seconds
};

/// A recording that is played, as the API sees and steers it. May be used by several threads at once.
class PlaybackControl {
 public:
  virtual ~PlaybackControl() = default;
  virtual ReplayState state() const = 0;
  /// Returns how often it was begun again, because an earlier position was asked for. What was shown before is not of
  /// this time any more.
  virtual std::uint64_t generation() const = 0;
  /// Returns null while the recording is being read for it.
  virtual std::shared_ptr<const RecordingOutline> outline() const = 0;
  virtual void change(const PlaybackChange& change) = 0;
};

}  // namespace citylearn
