#pragma once

#include <chrono>
#include <cstdint>

namespace citylearn {

/// What incarnations, jobs and charges are: larger for whoever came later.
inline std::uint64_t microseconds_since_epoch() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::microseconds>(now).count());
}

}  // namespace citylearn
