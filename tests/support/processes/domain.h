// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cstdint>
#include <string>

#include "core/util/error.h"

namespace citylearn::testing {

/// Returns a DDS domain that no other test on this machine has, so that tests can run side by side. It is taken until
/// this process and all programs that it starts from now on have ended.
inline std::uint32_t own_domain() {
  constexpr int kFirst = 110, kCount = 90;
  static int next = getpid();  // a domain that was just given back is not the first choice
  for (int tried = 0; tried < kCount; ++tried) {
    const int domain = kFirst + next++ % kCount;
    // No O_CLOEXEC: a program that outlives its test keeps the domain.
    const int file = open(("/tmp/citylearn-test-domain-" + std::to_string(domain)).c_str(), O_RDWR | O_CREAT, 0666);
    if (file >= 0 && flock(file, LOCK_EX | LOCK_NB) == 0) return static_cast<std::uint32_t>(domain);
    if (file >= 0) close(file);
  }
  throw Error("no DDS domain is free for a test", "/tmp/citylearn-test-domain-*");
}

}  // namespace citylearn::testing
