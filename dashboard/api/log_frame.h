// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "dashboard/logged/log_batch.h"

namespace citylearn {

// Points of a log as columns of numbers: a twentieth of the work that JSON takes (docs/reference/dashboard-api.md,
// "Logged runs").

inline constexpr const char* kLogFrameType = "application/octet-stream";  ///< Content-Type of such a body

/// Points of one frame, at least, so that a record of as many metrics as a run may have fits with others.
inline constexpr std::size_t kPointsOfFrame = 100'000;

/// Returns the frame of points [from, to) of `batch`, which are whole records. Its `first` is that of the first of
/// them, `ended` is left out unless `last`.
std::string log_frame(const LogBatch& batch, std::size_t from, std::size_t to, bool last);

/// Returns the batch of a frame, its points alone: source and log may be empty. Throws Error, saying what is wrong with
/// it.
LogBatch parse_log_frame(std::string_view frame);

}  // namespace citylearn
