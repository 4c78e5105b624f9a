#pragma once

#include <functional>

#include "core/middleware.h"

namespace citylearn::testing {

inline constexpr std::chrono::seconds kPatience{20};  // a loaded machine is slow, a broken one is never right

/// Asks `condition` again and again, letting `middleware` wait in between; false when it never came true.
inline bool eventually(Middleware& middleware, const std::function<bool()>& condition,
                       std::chrono::milliseconds patience = kPatience) {
  const Clock::time_point deadline = Clock::now() + patience;
  while (!condition()) {
    if (Clock::now() >= deadline) return false;
    middleware.wait(Clock::now() + std::chrono::milliseconds(5));
  }
  return true;
}

}  // namespace citylearn::testing
