// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstddef>
#include <vector>

namespace citylearn {

/// The clock of deadlines and durations. It never jumps.
using Clock = std::chrono::steady_clock;

inline double seconds_since(Clock::time_point start) {
  return std::chrono::duration<double>(Clock::now() - start).count();
}

/// Raw bytes, for example of one encoded message.
using Bytes = std::vector<std::byte>;

}  // namespace citylearn
