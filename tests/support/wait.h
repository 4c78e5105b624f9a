// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>

#include "core/dds/middleware.h"

namespace citylearn::testing {

using std::chrono::milliseconds;
using std::chrono::seconds;

/// Sanitizers slow down what they watch (GCC's names for them): every deadline of the tests is so many times later.
#if defined(__SANITIZE_THREAD__)
inline constexpr int kSlowness = 8;
#elif defined(__SANITIZE_ADDRESS__)
inline constexpr int kSlowness = 4;
#else
inline constexpr int kSlowness = 1;
#endif

inline constexpr seconds kMaxWait{20 * kSlowness};  ///< a loaded machine is slow, a broken one is never right

/// Asks `condition` again and again, with a `turn` of something that waits for a short while in between; false when it
/// never came true.
inline bool eventually(const std::function<void()>& turn, const std::function<bool()>& condition,
                       milliseconds patience = kMaxWait) {
  const Clock::time_point deadline = Clock::now() + patience;
  while (!condition()) {
    if (Clock::now() >= deadline) return false;
    turn();
  }
  return true;
}

inline bool eventually(Middleware& middleware, const std::function<bool()>& condition,
                       milliseconds patience = kMaxWait) {
  return eventually([&] { middleware.wait(Clock::now() + milliseconds(5)); }, condition, patience);
}

}  // namespace citylearn::testing
