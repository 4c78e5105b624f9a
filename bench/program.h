// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/support/service.h"

namespace citylearn::bench {

/// Waits until the program has ended and returns its output. Throws Error unless its exit status is 0.
inline std::string finish(testing::Service& program, const std::string& what,
                          std::chrono::minutes patience = std::chrono::minutes(20)) {
  if (program.wait(patience) != 0) throw Error(what + " failed:\n" + program.output());
  return program.output();
}

}  // namespace citylearn::bench
