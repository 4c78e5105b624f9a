// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <ctime>
#include <string>

namespace citylearn {

/// Returns the time. Recordings say so when messages came.
inline std::uint64_t nanoseconds_since_epoch() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return static_cast<std::uint64_t>(std::chrono::duration_cast<std::chrono::nanoseconds>(now).count());
}

/// Returns the time. Incarnations, run ids and leases are such times: later ones are larger.
inline std::uint64_t microseconds_since_epoch() { return nanoseconds_since_epoch() / 1000; }

inline double seconds_since_epoch() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

/// Returns "2026-11-22 04:35:21 UTC".
inline std::string date_of(std::time_t time) {
  std::tm parts{};
  gmtime_r(&time, &parts);
  char text[32];
  std::strftime(text, sizeof text, "%Y-%m-%d %H:%M:%S UTC", &parts);
  return text;
}

}  // namespace citylearn
