// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <poll.h>

#include <cstdio>
#include <exception>

namespace citylearn::testing {

/// Returns whether standard input has ended, as it does when the test lets this program go.
inline bool input_ended() {
  pollfd input{0, POLLIN, 0};
  return ::poll(&input, 1, 0) > 0;
}

/// Runs a program that takes `wanted` arguments: its exit status, 2 for another number of them, 1 for an exception.
inline int peer_main(int wanted, int count, char** arguments, int (*run)(char** arguments)) {
  if (count != wanted + 1) return 2;
  try {
    return run(arguments);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s: %s\n", arguments[0], error.what());
    return 1;
  }
}

}  // namespace citylearn::testing
