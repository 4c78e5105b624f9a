// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <vector>

#include "core/recording/outline.h"
#include "core/recording/replay_clock.h"

namespace citylearn {

/// A moment of a training run, as the page's address names it: a point on an axis of its curves.
struct Moment {
  std::string run;   ///< its ID, as run_id() writes it
  std::string axis;  ///< one of moment_axes()
  double at = 0;
};

/// Returns "update", "steps", "episodes" and "wall" (seconds of training).
const std::vector<std::string>& moment_axes();

/// Returns the position, in seconds, of the update of the run that is nearest to the moment; nothing when the recording
/// is at that update. Beyond the run's updates, the nearest is the first or the last. Throws Error when the recording
/// has no update of the run.
std::optional<double> position_of(const Moment& moment, const RecordingOutline& outline, const ReplayState& state);

/// Returns how far each run is at a position, in seconds: {ID: {"update", "steps", "episodes", "wall"}}, without those
/// that have no update by then.
nlohmann::json moments_at(const RecordingOutline& outline, double position);

/// Returns the first and the last moment of each run: {ID: {"first": {...}, "last": {...}}}.
nlohmann::json moment_spans(const RecordingOutline& outline);

}  // namespace citylearn
