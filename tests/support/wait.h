#pragma once

#include <functional>

#include "core/middleware.h"

namespace citylearn::testing {

inline constexpr std::chrono::seconds kPatience{20};  // a loaded machine is slow, a broken one is never right

/// Asks `condition` again and again, with a `turn` of something that waits for a short while in between; false when it
/// never came true.
inline bool eventually(const std::function<void()>& turn, const std::function<bool()>& condition,
                       std::chrono::milliseconds patience = kPatience) {
  const Clock::time_point deadline = Clock::now() + patience;
  while (!condition()) {
    if (Clock::now() >= deadline) return false;
    turn();
  }
  return true;
}

inline bool eventually(Middleware& middleware, const std::function<bool()>& condition,
                       std::chrono::milliseconds patience = kPatience) {
  return eventually([&] { middleware.wait(Clock::now() + std::chrono::milliseconds(5)); }, condition, patience);
}

}  // namespace citylearn::testing
