// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "tests/support/processes/service.h"

namespace citylearn::bench {

/// Returns the command line of a service in a session of its own.
inline std::vector<std::string> on_wire(std::vector<std::string> command, const std::string& middleware, int domain,
                                        const std::string& session = "") {
  command.insert(command.end(), {"--middleware", middleware, "--domain", std::to_string(domain), "--session",
                                 "bench-" + std::to_string(getpid()) + session});
  return command;
}

/// Waits until the program has ended and returns its output. Throws Error unless its exit status is 0.
inline std::string finish(testing::Service& program, const std::string& what,
                          std::chrono::minutes patience = std::chrono::minutes(20)) {
  if (program.wait(patience) != 0) throw Error(what + " failed:\n" + program.output());
  return program.output();
}

}  // namespace citylearn::bench
